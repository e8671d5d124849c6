"""Cross-frame windows with the paper's book-keeping: what has left the window is one Gaussian per point.

The last b frames are solved as a whole over all their motions and points. A frame that leaves turns into priors
of its points; correlations between points are dropped, as in the paper. There are three choices of where priors live:

* WC, eq. (47): in the world, each leaving view fused into its own point with the noise of its pose. The priors forget
  that all points share the drift, so the covariance of the pose is far too small.
* CC, anchored, eq. (49): in the last camera that left. With every frame that leaves, points are carried into it with
  the cross-covariance of points and motion; the pose in the world is the composition of the window's motions.
* CC, literal, eq. (48): the paper's two-frame transform X' = R X + T, Σ' = R Σ Rᵀ + J Γ Jᵀ with the motion's
  covariance Γ taken as independent of the point, then the view of the frame that leaves added to it (used twice).

b = 1 is the classical depth filter.
"""

from typing import ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...geometry import se3
from ...geometry.stereo import StereoProjection
from ...types import Observations, Solution, Status
from ..initial_motion import initial_motion
from ..lifecycle import WorldPoints, first_solution, frame_status, lost_solution, recorded, too_few_inliers
from ..motion_model import MotionModel
from .bundle_adjustment import Adjustment
from .per_point_map import PerPointMap
from .per_point_priors import LeavingRule, camera_centred, camera_centred_literal, world_centred


class _PerPointWindow:
    """A window with one Gaussian per point for what has left it; the subclasses name the rule."""

    name: str
    rule: ClassVar[LeavingRule]

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        self._projection = projection
        self._config = config
        self._motion = MotionModel(config.motion)
        self._map: PerPointMap | None = None

    def step(self, observations: Observations) -> Solution:
        """Take the next frame; see `Estimator.step`."""
        try:
            return self._start(observations) if self._map is None else self._advance(self._map, observations)
        except np.linalg.LinAlgError:
            self._map = None
            reason = "the points that are left do not determine the motion"
            return lost_solution(observations, reason, *self._motion.predict(observations.stamp_ns))

    def _start(self, obs: Observations) -> Solution:
        solution = first_solution(self._projection, self._config.robust, self._motion, obs)
        if solution.status is Status.INITIALISING:
            self._map = PerPointMap(self._projection, self._config, obs, solution)
        return solution

    def _advance(self, current: PerPointMap, obs: Observations) -> Solution:
        predicted, cov_predicted = self._motion.predict(obs.stamp_ns)
        before = current.points_in_world()
        newest = current.window[-1].ref_from_cam
        shared, known, rows = np.intersect1d(current.ids, obs.track_ids, True, True)
        in_cam, cov_in_cam = current.points_in_newest_camera()
        found = initial_motion(
            self._projection,
            self._config.robust,
            obs,
            rows,
            in_cam[known],
            cov_in_cam[known],
            se3.inverse(predicted) @ (current.world_from_ref @ newest),
        )
        if found is None:
            self._map = None
            reason = too_few_inliers(0, len(shared), self._config.robust)
            return lost_solution(obs, reason, predicted, cov_predicted, before)
        ref_from_cam = se3.orthonormalise(newest @ se3.inverse(found.cam_from_ref))
        if len(current.window) >= self._config.window.frames:
            ref_from_cam = current.let_oldest_leave(type(self).rule) @ ref_from_cam
        current.append(obs, ref_from_cam, shared, rows[found.accepted], held=False)
        result = current.solve()
        ended = before.select(~np.isin(before.ids, current.ids))
        rejected = np.setdiff1d(shared, current.window[-1].ids)
        return self._report(current, obs, len(shared) - len(rejected), rejected, ended, result)

    def _report(
        self,
        current: PerPointMap,
        obs: Observations,
        inliers: int,
        rejected: NDArray[np.int64],
        ended: WorldPoints,
        result: Adjustment,
    ) -> Solution:
        """Read the Solution off the window, and give the pose to the motion model."""
        world_from_cam, cov_pose = current.newest_pose()
        status, reason = frame_status(inliers, obs.note, self._config.robust)
        in_cam, cov_in_cam = current.points_in_newest_camera()
        in_world = current.points_in_world()
        now = np.isin(current.ids, current.window[-1].ids)
        solution = Solution(
            status=status,
            reason=reason,
            world_from_cam=world_from_cam,
            cov_pose=cov_pose,
            track_ids=current.ids[now],
            points_in_cam=in_cam[now],
            cov_points=cov_in_cam[now],
            points_in_world=in_world.points[now],
            cov_points_in_world=in_world.cov_points[now],
            window_frame_indices=np.array([f.index for f in current.window], np.int64),
            window_world_from_cam=np.stack([current.world_from_ref @ f.ref_from_cam for f in current.window]),
            rejected_ids=rejected,
            ended_ids=ended.ids,
            ended_points_in_world=ended.points,
            ended_cov_points_in_world=ended.cov_points,
            iterations=result.iterations,
            nis=result.cost,
            nis_dof=current.degrees_of_freedom(),
        )
        return recorded(self._motion, obs, solution)


class CrossFrameWC(_PerPointWindow):
    """Window with per-point priors in the world frame."""

    name = "cross-frame-wc"
    rule = world_centred


class CrossFrameCC(_PerPointWindow):
    """Window with per-point priors in the last camera that left it."""

    name = "cross-frame-cc"
    rule = camera_centred


class CrossFrameCCLiteral(_PerPointWindow):
    """Window with per-point priors in the last camera that left it, by the paper's two-frame transform."""

    name = "cross-frame-cc-literal"
    rule = camera_centred_literal


class DepthFilter(CrossFrameWC):
    """The classical filter of one Gaussian per point: a window of one frame, whatever the configuration says."""

    name = "depth-filter"

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        one = msgspec.structs.replace(config.window, frames=1)
        super().__init__(projection, msgspec.structs.replace(config, window=one))
