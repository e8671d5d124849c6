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

import numpy as np

from ...geometry import se3
from ...types import Observations, Solution
from ..lifecycle import WorldPoints, frame_status, solution_of
from .baseline import Baseline
from .per_point_map import PerPointMap
from .per_point_priors import LeavingRule, camera_centred, camera_centred_literal, world_centred


class _PerPointWindow(Baseline):
    """A window with one Gaussian per point for what has left it; the subclasses name the rule."""

    rule: ClassVar[LeavingRule]
    _map: PerPointMap

    def _begin(self, obs: Observations, first: Solution) -> WorldPoints:
        self._map = PerPointMap(self._projection, self._config, obs, first)
        return self._map.points_in_world()

    def _advance(self, obs: Observations, before: WorldPoints) -> tuple[Solution, WorldPoints]:
        current = self._map
        newest = current.window[-1].ref_from_cam
        shared, known, rows = np.intersect1d(current.ids, obs.track_ids, True, True)
        in_cam, cov_in_cam = current.points_in_newest_camera()
        world_from_previous = current.world_from_ref @ newest
        found = self._initial_motion(obs, rows, in_cam[known], cov_in_cam[known], world_from_previous)
        ref_from_cam = se3.orthonormalise(newest @ se3.inverse(found.cam_from_ref))
        if len(current.window) >= self._config.window.frames:
            ref_from_cam = current.let_oldest_leave(type(self).rule) @ ref_from_cam
        current.append(obs, ref_from_cam, shared, rows[found.accepted], held=False)
        result = current.solve()
        self._structure = in_world = current.points_in_world()
        rejected = np.setdiff1d(shared, current.window[-1].ids)
        world_from_cam, cov_pose = current.newest_pose()
        now = np.isin(current.ids, current.window[-1].ids)
        solution = solution_of(
            obs,
            frame_status(len(shared) - len(rejected), obs.note, self._config.robust),
            world_from_cam,
            cov_pose,
            WorldPoints(current.ids, *current.points_in_newest_camera()).select(now),
            in_world.select(now),
            window_frame_indices=np.array([f.index for f in current.window], np.int64),
            window_world_from_cam=np.stack([current.world_from_ref @ f.ref_from_cam for f in current.window]),
            rejected_ids=rejected,
            iterations=result.iterations,
            nis=result.cost,
            nis_dof=current.degrees_of_freedom(),
        )
        return solution, before.select(~np.isin(before.ids, current.ids))


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
