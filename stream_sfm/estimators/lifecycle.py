"""How a map begins and ends in every estimator: the first Solution, the status, the Solution while lost."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry import Array
from ..geometry.resection import MANY_VIEWS, Resection
from ..geometry.robust_rules import RobustRules
from ..geometry.stereo import StereoProjection
from ..record import columns_at
from ..types import Observations, Solution, Status
from .motion_model import MotionModel, Unreliable
from .triangulation import points_to_world, triangulate, usable_births


class WorldPoints(NamedTuple):
    """Points in one frame, usually the world: `ids` (k,), `points` (k, 3) m, `cov_points` (k, 3, 3) m²."""

    ids: NDArray[np.int64]
    points: Array
    cov_points: Array

    @classmethod
    def merge(cls, parts: Sequence["WorldPoints"]) -> "WorldPoints":
        """Return one list, ascending by id."""
        ids, points, covs = (np.concatenate([part[k] for part in parts]) for k in range(3))
        order = np.argsort(ids)
        return cls(ids[order], points[order], covs[order])

    def select(self, rows: NDArray[np.bool_]) -> "WorldPoints":
        """Return the points where the mask (k,) is true."""
        return WorldPoints(*columns_at(self, rows))


class LostError(Exception):
    """No motion was found for the frame; the message becomes the reason in the Solution."""


def frame_status(
    inliers: int, sought: int, note: str, config: RobustRules, motion: Resection | None = None
) -> tuple[Status, str]:
    """Return status and reason of an estimated frame, of whose views of `sought` points `inliers` are accepted.

    `note`: as in Observations; `motion`: its robust first motion.
    """
    reasons = []
    if motion is not None and motion.ambiguous is not None:
        reasons.append("two rigid motions agree with the views")
    elif motion is not None and motion.share < config.degraded_share:
        reasons.append(f"only {motion.share:.0%} of the views, by their history, agree with one motion")
    if inliers < min(config.degraded_inliers, max(MANY_VIEWS, config.chance_share * sought)):
        reasons.append(f"only {inliers} accepted views of {sought} points sought")
    if note:
        reasons.append(note)
    return (Status.DEGRADED if reasons else Status.OK), "; ".join(reasons)


def solution_of(
    observations: Observations,
    status: tuple[Status, str],
    world_from_cam: Array,
    cov_pose: Array,
    in_cam: WorldPoints,
    in_world: WorldPoints,
    **more: Any,
) -> Solution:
    """Return the Solution of a frame with points (n) in the camera and the same in the world, and `more` of its fields.

    Its window is this frame alone, unless `more` contains another.
    """
    window = {
        "window_frame_indices": np.array([observations.frame_index], np.int64),
        "window_world_from_cam": world_from_cam[None],
    }
    ids, points, covs = in_cam
    world = in_world.points, in_world.cov_points
    return Solution(*status, world_from_cam, cov_pose, ids, points, covs, *world, **window | more)


def with_ended(solution: Solution, ended: WorldPoints) -> Solution:
    """Return the solution of the frame with which these points left the estimator."""
    return replace(
        solution,
        ended_ids=ended.ids,
        ended_points_in_world=ended.points,
        ended_cov_points_in_world=ended.cov_points,
    )


def recorded(motion: MotionModel, observations: Observations, solution: Solution, ended: WorldPoints) -> Solution:
    """Give the pose of an estimated frame to the motion model, and return the Solution to report, with `ended` points.

    A pose from images that do not fit each other is used, although the pose predicted from earlier frames may be the
    true one: the covariances of the pose and of the points in the world cover both, and relative motions are not
    reported. After a start that was never confirmed, they keep what they covered last. Raises
    LinAlgError for a pose that is not finite, before anything learns from it.
    """
    if not (np.isfinite(solution.world_from_cam).all() and np.isfinite(solution.cov_pose).all()):
        raise np.linalg.LinAlgError("the pose is not finite")
    solution = with_ended(solution, ended)
    of_start = observations.ambiguity is not None and observations.ambiguity.of_start
    unreliable = Unreliable(observations.misfit, of_start, observations.unconfirmed)
    cov = motion.add(observations.stamp_ns, solution.world_from_cam, solution.cov_pose, unreliable)
    if observations.misfit:
        solution = replace(solution, relative=None)
    if cov is solution.cov_pose:
        return solution
    seen = solution.points_in_cam, solution.cov_points_in_world, solution.world_from_cam
    return replace(solution, cov_pose=cov, cov_points_in_world=core.widened_points(*seen, cov - solution.cov_pose))


def too_few_inliers(inliers: int, known: int, config: RobustRules) -> str:
    """Return the reason of a frame that is lost because too few views were accepted."""
    return f"{inliers} of {known} views of known points accepted, {config.min_inliers} needed"


def lost_solution(
    observations: Observations,
    reason: str,
    world_from_cam: Array,
    cov_pose: Array,
    ended: WorldPoints | None = None,
) -> Solution:
    """Return the Solution of a lost frame: a predicted pose and no structure."""
    nothing = WorldPoints(np.empty(0, np.int64), np.empty((0, 3)), np.empty((0, 3, 3)))
    reason = f"{reason}; {observations.note}" if observations.note else reason
    solution = solution_of(observations, (Status.LOST, reason), world_from_cam, cov_pose, nothing, nothing)
    return solution if ended is None else with_ended(solution, ended)


def first_solution(
    projection: StereoProjection, config: RobustRules, motion: MotionModel, observations: Observations
) -> Solution:
    """Return the Solution of a map's first frame: at the world's origin, or where the motion model predicts it.

    The status is initialising, with the points of this one frame; it is lost if there are too few of them. `motion`
    restarts from here.
    """
    obs = observations
    pose, cov_pose = motion.predict(obs.stamp_ns)
    first = not motion.started
    births = usable_births(projection, obs.z_px, obs.cov_px)
    enough = births.sum() >= config.min_inliers
    if first or enough:
        motion.restart(obs.stamp_ns, pose, cov_pose)
    if not enough:
        reason = f"{births.sum()} stereo points, {config.min_inliers} needed to start a map"
        return lost_solution(obs, reason, pose, cov_pose)
    in_cam = WorldPoints(obs.track_ids[births], *triangulate(projection, obs.z_px[births], obs.cov_px[births]))
    in_world = WorldPoints(in_cam.ids, *points_to_world(pose, cov_pose, in_cam.points, in_cam.cov_points))
    reason = "first frame: it is the world" if first else "new map at the predicted pose"
    return solution_of(obs, (Status.INITIALISING, reason), pose, cov_pose, in_cam, in_world)
