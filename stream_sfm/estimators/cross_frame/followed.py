"""The pose in the world that is reported: it goes on by the newest motion, and is drawn to the filter's pose.

With every frame the filter puts the frames before it elsewhere, too. The difference of two poses, each as it was
reported in its own frame, has the newest motion's error and that change. So the reported pose leaves the change out at
first, eq. (41a): it is where the newest motion leads from the pose reported before. What windows disagree in is renewed
within the b frames of one, so of the difference from the filter's pose a share of 1/b is taken each frame; more where
it is beyond half of the filter's own σ. What is left is known, and counts in the covariance. Nothing is fed back.
"""

import numpy as np

from ...config import WindowConfig
from ...geometry import Array, se3
from .marginals import Marginals


def followed(before: Marginals, now: Marginals, previous_from_newest: Array, rules: WindowConfig) -> Marginals:
    """Return the marginals `now` of the filter, with the newest pose and all that is seen from it as reported.

    `before`: those reported in the previous frame; `previous_from_newest` (4, 4): the newest motion.
    """
    start = se3.orthonormalise(before.world_from_cam @ previous_from_newest)
    apart = se3.log(se3.inverse(start) @ now.world_from_cam)
    left = apart * (1 - 1 / rules.frames)
    distance2 = float(left @ np.linalg.solve(now.cov_pose, left))
    left *= min(1.0, rules.most_followed / np.sqrt(max(distance2, 1e-30)))
    return now.moved(-left)
