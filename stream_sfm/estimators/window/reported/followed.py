"""The reported pose in the world: it continues by the newest motion, and is pulled to the filter's pose, eq. (41a).

With every frame the filter also moves the earlier frames. The difference of two poses, each as reported in its own
frame, would contain that change as well as the error of the newest motion. What the reported pose lags behind the
filter's is known, and is added to the covariance. Nothing is fed back.
"""

from .... import core
from ....geometry import Array
from ....record import changed
from .marginals import Marginals


def followed(
    before: Marginals, now: Marginals, previous_from_newest: Array, frames: int, most_sigmas: float
) -> Marginals:
    """Return the marginals `now` of the filter, moved to the reported pose together with the points seen from it.

    `before`: those reported in the previous frame; `previous_from_newest` (4, 4): the newest motion;
    `frames`: of the window, over which it comes nearer to the filter's; `most_sigmas`: its largest lag, σ.
    """
    world_from_cam, cov_pose, points_in_world, cov_points_in_world = core.followed_pose(
        *(before.world_from_cam, previous_from_newest, now.world_from_cam, now.cov_pose, now.points_in_cam),
        *(now.cov_points_in_world, 1 - 1 / frames, most_sigmas),
    )
    return changed(
        now,
        world_from_cam=world_from_cam,
        cov_pose=cov_pose,
        points_in_world=points_in_world,
        cov_points_in_world=cov_points_in_world,
    )
