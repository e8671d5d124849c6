"""The parts of a Solution that all baselines fill in alike: status, empty structure, the answer while lost."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..config import RobustConfig
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from ..types import Observations, Solution, Status
from .motion_model import MotionPrior
from .triangulation import points_to_world, triangulated, usable_births

Ended = tuple[NDArray[np.int64], Array, Array]  # ids (k,), points in world (k, 3), covariances (k, 3, 3)
NO_ENDED: Ended = (np.empty(0, np.int64), np.empty((0, 3)), np.empty((0, 3, 3)))


def status_of(accepted_views: int, note: str, config: RobustConfig) -> tuple[Status, str]:
    """Status and reason of a frame that was estimated from so many accepted views; `note` as in Observations."""
    few = f"only {accepted_views} accepted views (fewer than {config.degraded_views})"
    reason = "; ".join(text for text in (few if accepted_views < config.degraded_views else "", note) if text)
    return (Status.DEGRADED if reason else Status.OK), reason


def few_views(accepted: int, known: int, config: RobustConfig) -> str:
    """Why a frame is lost."""
    return f"{accepted} of {known} views of known points accepted, {config.min_views} needed"


def joined(parts: Sequence[Ended]) -> Ended:
    """One list of ended points, ascending by id."""
    ids, points, covs = (np.concatenate([p[k] for p in parts]) for k in range(3))
    order = np.argsort(ids)
    return ids[order], points[order], covs[order]


def solution_without_points(
    observations: Observations,
    status: Status,
    reason: str,
    world_from_cam: Array,
    cov_pose: Array,
    ended: Ended = NO_ENDED,
    rejected_ids: NDArray[np.int64] | None = None,
) -> Solution:
    """A frame whose pose is predicted and that holds no structure."""
    return Solution(
        status=status,
        reason=f"{reason}; {observations.note}" if observations.note else reason,
        world_from_cam=world_from_cam,
        cov_pose=cov_pose,
        track_ids=np.empty(0, np.int64),
        points_in_cam=np.empty((0, 3)),
        cov_points=np.empty((0, 3, 3)),
        points_in_world=np.empty((0, 3)),
        cov_points_in_world=np.empty((0, 3, 3)),
        window_frame_indices=np.array([observations.frame_index], np.int64),
        window_world_from_cam=world_from_cam[None],
        rejected_ids=np.empty(0, np.int64) if rejected_ids is None else rejected_ids,
        ended_ids=ended[0],
        ended_points_in_world=ended[1],
        ended_cov_points_in_world=ended[2],
    )


def open_map(
    projection: StereoProjection, config: RobustConfig, motion: MotionPrior, observations: Observations
) -> Solution:
    """The first frame of a map: at the world's origin, or where the motion's prediction puts it.

    Status initialising, with the points of this one view; lost where there are too few to start from. `motion`
    is restarted from here.
    """
    obs = observations
    pose, cov_pose = motion.predict(obs.stamp_ns)
    first = not motion.started
    births = usable_births(projection, obs.z_px, obs.cov_px)
    enough = births.sum() >= config.min_views
    if first or enough:
        motion.restart(obs.stamp_ns, pose, cov_pose)
    if not enough:
        reason = f"{births.sum()} stereo points, {config.min_views} needed to start a map"
        return solution_without_points(obs, Status.LOST, reason, pose, cov_pose)
    in_cam, cov_points = triangulated(projection, obs.z_px[births], obs.cov_px[births])
    in_world, cov_in_world = points_to_world(pose, cov_pose, in_cam, cov_points)
    return Solution(
        status=Status.INITIALISING,
        reason="first frame: it is the world" if first else "new map at the predicted pose",
        world_from_cam=pose,
        cov_pose=cov_pose,
        track_ids=obs.track_ids[births],
        points_in_cam=in_cam,
        cov_points=cov_points,
        points_in_world=in_world,
        cov_points_in_world=cov_in_world,
        window_frame_indices=np.array([obs.frame_index], np.int64),
        window_world_from_cam=pose[None],
    )
