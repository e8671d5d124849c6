"""Cross-frame windows with the paper's bookkeeping: one Gaussian per point for all that has left the window.

The last b frames are solved jointly over all their motions and points. A frame that leaves becomes priors of its
points; correlations between points are dropped, as in the paper. The priors are in the world (WC, eq. (47)) or in the
last camera that left, with the cross-covariance of points and motion (CC, anchored, eq. (49)) or with the paper's
transform, which takes them as independent and uses the view twice (CC, literal, eq. (48)). b = 1 is the classical
depth filter.
"""

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...geometry import Array, se3
from ...geometry.gates import chi2_gates
from ...record import changed, record
from ...types import Observations, Solution
from ..lifecycle import WorldPoints, frame_status, solution_of
from ..triangulation import compose_cov, points_to_world, triangulate, usable_births
from .baseline import Baseline
from .bundle_adjustment import Adjustment, PointPriors, Problem, WeightedViews
from .per_point_priors import Leaving, LeavingRule, camera_centred, camera_centred_literal, world_centred


@record
class PerPointFrame:
    """A frame of the window: its pose, which is fixed if `held`, and its accepted views of points of the map."""

    index: int
    ref_from_cam: Array
    held: bool
    ids: NDArray[np.int64]
    z_px: Array
    cov_px: Array

    def select(self, rows: NDArray[np.bool_]) -> "PerPointFrame":
        """Return the frame with the views of a mask only."""
        return changed(self, ids=self.ids[rows], z_px=self.z_px[rows], cov_px=self.cov_px[rows])


class _PerPointWindow(Baseline):
    """A window with one Gaussian per point for all that has left it; subclasses choose the rule.

    The frame ref is the world, or the last camera that left. `_ids` (n,), ascending: points with a prior or a view in
    the window; `_points` (n, 3) m in ref; `_priors`: their priors, zero for none; `_covariances`: poses and points of
    the last solve.
    """

    rule: ClassVar[LeavingRule]

    def _begin(self, obs: Observations, first: Solution) -> WorldPoints:
        """Begin a map in the camera of `first`, which is ref and is fixed."""
        self._window: list[PerPointFrame] = []
        self._world_from_ref, self._cov_ref = first.world_from_cam, first.cov_pose
        self._ids = np.empty(0, np.int64)
        self._points = np.empty((0, 3))
        self._priors = PointPriors(np.empty((0, 3)), np.empty((0, 3, 3)))
        self._append(obs, np.eye(4), np.empty(0, np.int64), np.empty(0, np.intp), held=True)
        self._solve()
        return self._points_in_world()

    def _advance(self, obs: Observations, before: WorldPoints) -> tuple[Solution, WorldPoints]:
        newest = self._window[-1].ref_from_cam
        shared, known, rows = np.intersect1d(self._ids, obs.track_ids, True, True)
        in_cam, cov_in_cam = self._points_in_newest_camera()
        world_from_previous = self._world_from_ref @ newest
        found = self._initial_motion(obs, rows, in_cam[known], cov_in_cam[known], world_from_previous)
        ref_from_cam = se3.orthonormalise(newest @ se3.inverse(found.cam_from_ref))
        if len(self._window) >= self._config.window.frames:
            ref_from_cam = self._let_oldest_leave(type(self).rule) @ ref_from_cam
        self._append(obs, ref_from_cam, shared, rows[found.accepted], held=False)
        result = self._solve()
        self._structure = in_world = self._points_in_world()
        rejected = np.setdiff1d(shared, self._window[-1].ids)
        ref_from_cam = self._window[-1].ref_from_cam
        cov_pose = compose_cov(self._cov_ref, ref_from_cam, self._covariances.cov_pose(len(self._window) - 1))
        now = np.isin(self._ids, self._window[-1].ids)
        solution = solution_of(
            obs,
            frame_status(len(shared) - len(rejected), len(shared), obs.note, self._robust),
            se3.orthonormalise(self._world_from_ref @ ref_from_cam),
            cov_pose,
            WorldPoints(self._ids, *self._points_in_newest_camera()).select(now),
            in_world.select(now),
            window_frame_indices=np.array([f.index for f in self._window], np.int64),
            window_world_from_cam=np.stack([self._world_from_ref @ f.ref_from_cam for f in self._window]),
            rejected_ids=rejected,
            iterations=result.iterations,
            nis=result.cost,
            nis_dof=self._degrees_of_freedom(),
        )
        return solution, before.select(~np.isin(before.ids, self._ids))

    def _append(
        self,
        obs: Observations,
        ref_from_cam: Array,
        shared: NDArray[np.int64],
        accepted: NDArray[np.intp],
        held: bool,
    ) -> None:
        """Add the newest frame with its accepted views (rows of obs), and start the points that it sees first."""
        births = usable_births(self._projection, obs.z_px, obs.cov_px)
        births &= ~np.isin(obs.track_ids, self._ids) & ~np.isin(obs.track_ids, shared)
        in_cam, _ = triangulate(self._projection, obs.z_px[births], obs.cov_px[births])
        n = len(in_cam)
        self._ids = np.concatenate([self._ids, obs.track_ids[births]])
        self._points = np.concatenate([self._points, se3.transform(ref_from_cam, in_cam)])
        self._priors = PointPriors(
            np.concatenate([self._priors.mean, np.zeros((n, 3))]),
            np.concatenate([self._priors.information, np.zeros((n, 3, 3))]),
        )
        rows = np.union1d(accepted[np.isin(obs.track_ids[accepted], self._ids)], np.flatnonzero(births))
        ids, z_px, cov_px = obs.track_ids[rows], obs.z_px[rows], obs.cov_px[rows]
        self._window.append(PerPointFrame(obs.frame_index, ref_from_cam, held, ids, z_px, cov_px))
        self._drop_undetermined()

    def _drop_undetermined(self) -> None:
        """Keep the points that the window sees and that a prior or a complete view locates; ascending by id."""
        seen = np.concatenate([f.ids for f in self._window])
        stereo = np.concatenate([f.ids[np.isfinite(f.z_px).all(axis=1)] for f in self._window])
        located = np.isin(self._ids, stereo) | self._has_prior()
        keep = np.flatnonzero(np.isin(self._ids, seen) & located)
        keep = keep[np.argsort(self._ids[keep])]
        self._ids, self._points = self._ids[keep], self._points[keep]
        self._priors = PointPriors(self._priors.mean[keep], self._priors.information[keep])
        self._window = [f.select(np.isin(f.ids, self._ids)) for f in self._window]

    def _has_prior(self) -> NDArray[np.bool_]:
        return np.asarray((self._priors.information != 0).any(axis=(1, 2)))

    def _solve(self) -> Adjustment:
        """Estimate all motions and points of the window jointly; views that do not fit are removed once.

        Raises LinAlgError if no points are left.
        """
        for last in (False, True):
            if not len(self._ids):
                raise np.linalg.LinAlgError("no points are left")
            poses = np.stack([f.ref_from_cam for f in self._window])
            free = np.array([not f.held for f in self._window])
            views = _views(self._window, self._ids)
            problem = Problem(self._projection, views, free, self._priors)
            # the tolerance is a few hundredths of a σ at a thousand views
            result = problem.minimum(poses, self._points, self._config.window.max_iterations, tolerance=1e-6)
            self._points = result.points
            self._window = [changed(f, ref_from_cam=p) for f, p in zip(self._window, result.ref_from_cam, strict=True)]
            dof = 2 * (views.information[:, [0, 2], [0, 2]] > 0).sum(axis=1)
            bad = result.squares > chi2_gates(dof, self._robust.gate_probability)
            if last or not bad.any():
                break
            for k, frame in enumerate(self._window):
                out = self._ids[views.point[bad & (views.frame == k)]]
                self._window[k] = frame.select(~np.isin(frame.ids, out))
            self._drop_undetermined()
        self._covariances = problem.linearised(result.ref_from_cam, self._points).covariances()
        return result

    def _let_oldest_leave(self, rule: LeavingRule) -> Array:
        """Turn the oldest frame into priors of its points, and return new_from_ref.

        If that frame becomes the reference, the pose of the reference in the world is composed with its motion.
        """
        frame = self._window.pop(0)
        ref_from_cam, cov_pose = frame.ref_from_cam, self._covariances.cov_pose(0)
        # one side alone does not determine the depth of a point without a prior
        known = np.isin(frame.ids, self._ids[self._has_prior()])
        frame = frame.select(known | np.isfinite(frame.z_px).all(axis=1))
        rows = np.flatnonzero(np.isin(self._ids, frame.ids) | self._has_prior())
        priors, moved = rule(
            Leaving(
                projection=self._projection,
                ref_from_cam=ref_from_cam,
                cov_pose=cov_pose,
                held=frame.held,
                points=self._points[rows],
                priors=PointPriors(self._priors.mean[rows], self._priors.information[rows]),
                views=_views([frame], self._ids[rows]),
            )
        )
        if moved is not None:
            self._cov_ref = compose_cov(self._cov_ref, ref_from_cam, cov_pose)
            self._world_from_ref = se3.orthonormalise(self._world_from_ref @ ref_from_cam)
        new_from_ref = np.eye(4) if moved is None else moved
        self._points = se3.transform(new_from_ref, self._points)
        mean, information = np.zeros_like(self._points), np.zeros((len(self._points), 3, 3))
        mean[rows], information[rows] = priors.mean, priors.information
        self._priors = PointPriors(mean, information)
        self._window = [
            changed(f, ref_from_cam=se3.orthonormalise(new_from_ref @ f.ref_from_cam)) for f in self._window
        ]
        return new_from_ref

    def _points_in_newest_camera(self) -> tuple[Array, Array]:
        """Return points (n, 3) and covariances (n, 3, 3) in the newest camera."""
        newest = self._window[-1].ref_from_cam
        in_cam = se3.transform(se3.inverse(newest), self._points)
        return in_cam, self._covariances.cov_points_in_cam(len(self._window) - 1, newest, in_cam)

    def _points_in_world(self) -> WorldPoints:
        """Return all points with their covariances in the world."""
        cov_points = self._covariances.cov_points
        return WorldPoints(self._ids, *points_to_world(self._world_from_ref, self._cov_ref, self._points, cov_points))

    def _degrees_of_freedom(self) -> int:
        """Return measurements and priors less unknowns of the last solve."""
        views = sum(int(np.isfinite(f.z_px).sum()) for f in self._window)
        moving = sum(not f.held for f in self._window)
        return views + 3 * int(self._has_prior().sum()) - 3 * len(self._ids) - 6 * moving


def _views(frames: list[PerPointFrame], ids: NDArray[np.int64]) -> WeightedViews:
    """Return the views of frames, all of points in `ids` (ascending)."""
    frame = np.repeat(np.arange(len(frames)), [len(f.ids) for f in frames])
    point = np.searchsorted(ids, np.concatenate([f.ids for f in frames]))
    z = np.concatenate([f.z_px for f in frames])
    return WeightedViews.sorted_by_point(frame, point, z, np.concatenate([f.cov_px for f in frames]))


class CrossFrameWC(_PerPointWindow):
    """Window with per-point priors in the world frame."""

    rule = world_centred


class CrossFrameCC(_PerPointWindow):
    """Window with per-point priors in the last camera that left it."""

    rule = camera_centred


class CrossFrameCCLiteral(_PerPointWindow):
    """Window with per-point priors in the last camera that left it, by the paper's two-frame transform."""

    rule = camera_centred_literal
