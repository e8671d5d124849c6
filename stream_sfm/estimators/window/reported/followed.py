"""The reported pose in the world: it continues by the newest motion, and is pulled to the filter's pose, eq. (41a).

With every frame the filter also moves the earlier frames. The difference of two poses, each as reported in its own
frame, would contain that change as well as the error of the newest motion. What the reported pose lags behind the
filter's is known, and is added to the covariance. Nothing is fed back.
"""

import numpy as np

from ....geometry import Array, se3
from .marginals import Marginals


def followed(
    before: Marginals, now: Marginals, previous_from_newest: Array, frames: int, most_sigmas: float
) -> Marginals:
    """Return the marginals `now` of the filter, moved to the reported pose together with the points seen from it.

    `before`: those reported in the previous frame; `previous_from_newest` (4, 4): the newest motion;
    `frames`: of the window, over which it comes nearer to the filter's; `most_sigmas`: its largest lag, σ.
    """
    start = se3.orthonormalise(before.world_from_cam @ previous_from_newest)
    apart = se3.log(se3.inverse(start) @ now.world_from_cam)
    left = apart * (1 - 1 / frames)
    distance2 = float(left @ np.linalg.solve(now.cov_pose, left))
    left *= min(1.0, most_sigmas / np.sqrt(max(distance2, 1e-30)))
    return now.moved(-left)
