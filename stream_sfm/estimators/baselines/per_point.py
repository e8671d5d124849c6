"""Cross-frame windows with the paper's book-keeping: what has left the window is one Gaussian a point.

The last b frames are solved as a whole over all their motions and points. A frame that leaves turns into priors
of its points; correlations between points are dropped, as in the paper. Three choices of where priors live:

* WC, eq. (47): in the world, each leaving view fused into its own point with the noise of its pose. The priors forget
  that all points share the drift, so the pose's covariance claims too much.
* CC, anchored, eq. (49): in the last camera that left. With every frame that leaves, points are carried into it with
  the cross-covariance of points and motion; the pose in the world is the composition of the window's motions.
* CC, literal, eq. (48): the paper's two-frame transform X' = R X + T, Σ' = R Σ Rᵀ + J Γ Jᵀ with the motion's
  covariance Γ taken as independent of the point, then the view of the frame that leaves added to it (used twice).

b = 1 is the classical depth filter. `ref` is the world (WC) or the last camera that left (CC).
"""

from dataclasses import dataclass, replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...geometry import se3
from ...geometry.gates import chi2_gates
from ...geometry.resection import Resection
from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection
from ...types import Observations, Solution, Status
from .. import lifecycle as outcome
from ..motion_model import MotionPrior, robust_start
from ..triangulation import compose_cov, points_to_world, triangulated, usable_births
from .bundle_adjustment import (
    Adjusted,
    Covariances,
    NormalEquations,
    PointPriors,
    Views,
    adjust,
    point_in_cam_jacobian,
    residuals_and_jacobians,
)


@dataclass(frozen=True, slots=True)
class _Frame:
    """A frame of the window: its pose, whether that is held, and its accepted views of points of the map."""

    index: int
    ref_from_cam: Array
    held: bool
    ids: NDArray[np.int64]
    z_px: Array
    cov_px: Array

    def only(self, keep: NDArray[np.bool_]) -> "_Frame":
        return replace(self, ids=self.ids[keep], z_px=self.z_px[keep], cov_px=self.cov_px[keep])


class CrossFrameWC:
    """Window with per-point priors in the world frame."""

    name = "cross-frame-wc"

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        self._projection = projection
        self._config = config
        self._motion = MotionPrior(config.motion)
        self._forget()

    def _forget(self) -> None:
        self._window: list[_Frame] = []
        self._world_from_ref, self._cov_ref = np.eye(4), np.zeros((6, 6))
        self._ids = np.empty(0, np.int64)  # the map: points with a prior or a view in the window
        self._points = np.empty((0, 3))  # in ref
        self._priors = PointPriors(np.empty((0, 3)), np.empty((0, 3, 3)))
        self._covariances: Covariances | None = None  # of the last solve: window's poses and the map

    def step(self, observations: Observations) -> Solution:
        """Take the next frame; see types.Estimator."""
        if self._covariances is None:
            return self._start(observations)
        try:
            return self._advance(observations)
        except np.linalg.LinAlgError:
            predicted, cov_predicted = self._motion.predict(observations.stamp_ns)
            self._forget()
            reason = "the points that are left do not determine the motion"
            return outcome.solution_without_points(observations, Status.LOST, reason, predicted, cov_predicted)

    def _advance(self, obs: Observations) -> Solution:
        predicted, cov_predicted = self._motion.predict(obs.stamp_ns)
        in_world = self._in_world()
        shared, known, rows = np.intersect1d(self._ids, obs.track_ids, True, True)
        found = self._resect(obs, known, rows, predicted)
        if found is None:
            reason = outcome.few_views(0, len(shared), self._config.robust)
            self._forget()
            return outcome.solution_without_points(obs, Status.LOST, reason, predicted, cov_predicted, in_world)
        ref_from_cam = se3.orthonormalise(self._window[-1].ref_from_cam @ se3.inverse(found.cam_from_ref))
        if len(self._window) >= self._config.window.frames:
            ref_from_cam = self._leave() @ ref_from_cam
        self._append(obs, ref_from_cam, shared, rows[found.accepted], held=False)
        result = self._solve()
        gone = ~np.isin(in_world[0], self._ids)
        ended = in_world[0][gone], in_world[1][gone], in_world[2][gone]
        rejected = np.setdiff1d(shared, self._window[-1].ids)
        return self._solution(obs, len(shared) - len(rejected), rejected, ended, result)

    def _start(self, obs: Observations) -> Solution:
        solution = outcome.open_map(self._projection, self._config.robust, self._motion, obs)
        if solution.status is Status.INITIALISING:
            self._world_from_ref, self._cov_ref = solution.world_from_cam, solution.cov_pose
            self._append(obs, np.eye(4), np.empty(0, np.int64), np.empty(0, np.intp), held=True)
            self._solve()
        return solution

    def _resect(
        self, obs: Observations, known: NDArray[np.intp], rows: NDArray[np.intp], predicted: Array
    ) -> Resection | None:
        """Robust motion since the newest camera, from the map as that camera knows it."""
        in_cam, cov_in_cam = self._in_newest_camera()
        world_from_last = self._world_from_ref @ self._window[-1].ref_from_cam
        starts = [se3.inverse(predicted) @ world_from_last, np.eye(4)]
        if obs.cam_from_previous is not None:
            starts.insert(0, obs.cam_from_previous)
        robust = self._config.robust
        return robust_start(
            self._projection,
            in_cam[known],
            cov_in_cam[known],
            obs.z_px[rows],
            obs.cov_px[rows],
            starts,
            robust.gate_probability,
            robust.min_views,
        )

    # The window

    def _append(
        self,
        obs: Observations,
        ref_from_cam: Array,
        shared: NDArray[np.int64],
        accepted: NDArray[np.intp],
        held: bool,
    ) -> None:
        """The newest frame joins with its accepted views (rows of obs), and opens points seen first."""
        births = usable_births(self._projection, obs.z_px, obs.cov_px)
        births &= ~np.isin(obs.track_ids, self._ids) & ~np.isin(obs.track_ids, shared)
        in_cam, _ = triangulated(self._projection, obs.z_px[births], obs.cov_px[births])
        n = len(in_cam)
        self._ids = np.concatenate([self._ids, obs.track_ids[births]])
        self._points = np.concatenate([self._points, se3.transform(ref_from_cam, in_cam)])
        self._priors = PointPriors(
            np.concatenate([self._priors.mean, np.zeros((n, 3))]),
            np.concatenate([self._priors.information, np.zeros((n, 3, 3))]),
        )
        rows = np.union1d(accepted[np.isin(obs.track_ids[accepted], self._ids)], np.flatnonzero(births))
        frame = _Frame(obs.frame_index, ref_from_cam, held, obs.track_ids[rows], obs.z_px[rows], obs.cov_px[rows])
        self._window.append(frame)
        self._tidy()

    def _tidy(self) -> None:
        """Keep the points that the window sees and that a prior or a complete view locates; ascending by id."""
        seen = np.unique(np.concatenate([f.ids for f in self._window] or [self._ids[:0]]))
        stereo = [f.ids[np.isfinite(f.z_px).all(axis=1)] for f in self._window]
        located = np.isin(self._ids, np.concatenate(stereo)) if stereo else np.zeros(len(self._ids), bool)
        located |= self._has_prior()
        keep = np.flatnonzero(np.isin(self._ids, seen) & located)
        keep = keep[np.argsort(self._ids[keep])]
        self._select(keep)
        self._window = [f.only(np.isin(f.ids, self._ids)) for f in self._window]

    def _has_prior(self) -> NDArray[np.bool_]:
        return np.asarray((self._priors.information != 0).any(axis=(1, 2)))

    def _select(self, rows: NDArray[np.intp]) -> None:
        self._ids, self._points = self._ids[rows], self._points[rows]
        self._priors = PointPriors(self._priors.mean[rows], self._priors.information[rows])

    def _views(self, frames: list[_Frame], ids: NDArray[np.int64]) -> Views:
        frame = np.repeat(np.arange(len(frames)), [len(f.ids) for f in frames])
        point = np.searchsorted(ids, np.concatenate([f.ids for f in frames]))
        z = np.concatenate([f.z_px for f in frames])
        return Views.sorted_by_point(frame, point, z, np.concatenate([f.cov_px for f in frames]))

    def _solve(self) -> Adjusted:
        """All motions and points of the window at once; views that do not fit leave, once; covariances are kept."""
        for last in (False, True):
            poses = np.stack([f.ref_from_cam for f in self._window])
            free = np.array([not f.held for f in self._window])
            views = self._views(self._window, self._ids)
            result = adjust(
                self._projection,
                poses,
                self._points,
                views,
                free,
                self._priors,
                self._config.window.max_iterations,
                tolerance=1e-6,
            )
            self._points = result.points
            self._window = [
                replace(f, ref_from_cam=p) for f, p in zip(self._window, result.ref_from_cam, strict=True)
            ]
            dof = 2 * (views.information[:, [0, 2], [0, 2]] > 0).sum(axis=1)
            bad = result.share > chi2_gates(dof, self._config.robust.gate_probability)
            if last or not bad.any():
                break
            for k, frame in enumerate(self._window):
                out = self._ids[views.point[bad & (views.frame == k)]]
                self._window[k] = frame.only(~np.isin(frame.ids, out))
            self._tidy()
        normal = NormalEquations.build(self._projection, result.ref_from_cam, self._points, views, self._priors)
        self._covariances = Covariances.of(normal.eliminate_points(free), free)
        return result

    def _leave(self) -> Array:
        """The oldest frame turns into priors of its points. Returns the new reference from the old one."""
        frame = self._window.pop(0)
        # one side alone would leave the depth of a point without prior open
        known = np.isin(frame.ids, self._ids[self._has_prior()])
        frame = frame.only(known | np.isfinite(frame.z_px).all(axis=1))
        rows = np.flatnonzero(np.isin(self._ids, frame.ids) | self._has_prior())
        priors = PointPriors(self._priors.mean[rows], self._priors.information[rows])
        mean, information, new_from_ref = self._new_priors(frame, rows, priors)
        self._points = se3.transform(new_from_ref, self._points)
        all_mean, all_information = np.zeros_like(self._points), np.zeros((len(self._points), 3, 3))
        all_mean[rows], all_information[rows] = mean, information
        self._priors = PointPriors(all_mean, all_information)
        self._window = [
            replace(f, ref_from_cam=se3.orthonormalise(new_from_ref @ f.ref_from_cam)) for f in self._window
        ]
        return new_from_ref

    def _new_priors(self, frame: _Frame, rows: NDArray[np.intp], priors: PointPriors) -> tuple[Array, Array, Array]:
        """Means and information of the points `rows` with the leaving frame in them, and new_from_ref.

        In WC each view is fused into its point on its own, with the noise of its pose as the window knows it:
        Λ' = Λ + Bᵀ (Σ_z + J Γ Jᵀ)⁻¹ B, B = ∂h/∂X, J = ∂h/∂ξ.
        """
        assert self._covariances is not None
        views = _covering(self._views([frame], self._ids[rows]), len(rows))
        points, poses = self._points[rows], frame.ref_from_cam[None]
        r, j_pose, j_point = residuals_and_jacobians(self._projection, poses, points, views)
        # (Σ + J Γ Jᵀ)⁻¹ = Ω − Ω J (Γ⁻¹ + JᵀΩJ)⁻¹ JᵀΩ, written so that Γ = 0 and Ω singular are allowed.
        ji = np.swapaxes(j_pose, 1, 2) @ views.information
        cov = self._covariances.cov_pose(0)
        gain = np.linalg.solve(np.eye(6) + cov @ (ji @ j_pose), cov @ ji)
        info = views.information - np.swapaxes(ji, 1, 2) @ gain
        jt = np.swapaxes(j_point, 1, 2) @ info
        information = priors.information + jt @ j_point
        right = priors.information @ (priors.mean - points)[..., None] + jt @ r[..., None]
        delta = np.linalg.solve(information, right)[..., 0]
        return points + delta, (information + np.swapaxes(information, 1, 2)) / 2, np.eye(4)

    # What is reported

    def _in_newest_camera(self) -> tuple[Array, Array]:
        assert self._covariances is not None
        newest = self._window[-1].ref_from_cam
        in_cam = se3.transform(se3.inverse(newest), self._points)
        return in_cam, self._covariances.cov_points_in_cam(len(self._window) - 1, newest, in_cam)

    def _in_world(self) -> outcome.Ended:
        assert self._covariances is not None
        points, cov = points_to_world(
            self._world_from_ref, self._cov_ref, self._points, self._covariances.cov_points
        )
        return self._ids, points, cov

    def _solution(
        self,
        obs: Observations,
        accepted: int,
        rejected: NDArray[np.int64],
        ended: outcome.Ended,
        result: Adjusted,
    ) -> Solution:
        assert self._covariances is not None
        newest = len(self._window) - 1
        ref_from_cam = self._window[-1].ref_from_cam
        world_from_cam = se3.orthonormalise(self._world_from_ref @ ref_from_cam)
        cov_pose = compose_cov(self._cov_ref, ref_from_cam, self._covariances.cov_pose(newest))
        self._motion.record(obs.stamp_ns, world_from_cam, cov_pose)
        status, reason = outcome.status_of(accepted, obs.note, self._config.robust)
        in_cam, cov_in_cam = self._in_newest_camera()
        _, in_world, cov_in_world = self._in_world()
        now = np.isin(self._ids, self._window[-1].ids)
        in_prior = int(self._has_prior().sum())
        views = sum(int(np.isfinite(f.z_px).sum()) for f in self._window)
        moving = sum(not f.held for f in self._window)
        return Solution(
            status=status,
            reason=reason,
            world_from_cam=world_from_cam,
            cov_pose=cov_pose,
            track_ids=self._ids[now],
            points_in_cam=in_cam[now],
            cov_points=cov_in_cam[now],
            points_in_world=in_world[now],
            cov_points_in_world=cov_in_world[now],
            window_frame_indices=np.array([f.index for f in self._window], np.int64),
            window_world_from_cam=np.stack([self._world_from_ref @ f.ref_from_cam for f in self._window]),
            rejected_ids=rejected,
            ended_ids=ended[0],
            ended_points_in_world=ended[1],
            ended_cov_points_in_world=ended[2],
            iterations=result.iterations,
            nis=result.cost,
            nis_dof=views + 3 * in_prior - 3 * len(self._ids) - 6 * moving,
        )


class CrossFrameCC(CrossFrameWC):
    """Window with per-point priors in the last camera that left it."""

    name = "cross-frame-cc"

    def _leave(self) -> Array:
        frame, covariances = self._window[0], self._covariances
        assert covariances is not None
        new_from_ref = super()._leave()
        self._cov_ref = compose_cov(self._cov_ref, frame.ref_from_cam, covariances.cov_pose(0))
        self._world_from_ref = se3.orthonormalise(self._world_from_ref @ frame.ref_from_cam)
        return new_from_ref

    def _leaving_part(
        self, frame: _Frame, rows: NDArray[np.intp], priors: PointPriors
    ) -> tuple[Covariances, Array, Array]:
        """What priors and the leaving frame alone say, linearised at the window's estimate: covariances of its pose
        and the points, and how far their minimum is from the estimate: ξ (6,), δX (p, 3)."""
        views = self._views([frame], self._ids[rows])
        views = _covering(views, len(rows))
        free = np.array([not frame.held])
        normal = NormalEquations.build(
            self._projection, frame.ref_from_cam[None], self._points[rows], views, priors
        )
        reduced = normal.eliminate_points(free)
        xi, delta = reduced.solve(normal.g_point)
        return Covariances.of(reduced, free), xi.reshape(-1, 6).sum(axis=0), delta

    def _new_priors(self, frame: _Frame, rows: NDArray[np.intp], priors: PointPriors) -> tuple[Array, Array, Array]:
        covariances, xi, delta = self._leaving_part(frame, rows, priors)
        cam_from_ref = se3.inverse(frame.ref_from_cam)
        in_cam = se3.transform(cam_from_ref, self._points[rows])
        mean = in_cam + delta @ cam_from_ref[:3, :3].T + point_in_cam_jacobian(in_cam) @ xi
        cov = covariances.cov_points_in_cam(0, frame.ref_from_cam, in_cam)
        return mean, np.asarray(np.linalg.inv(cov)), cam_from_ref


class CrossFrameCCLiteral(CrossFrameCC):
    """Window with per-point priors in the last camera that left it, by the paper's two-frame transform."""

    name = "cross-frame-cc-literal"

    def _new_priors(self, frame: _Frame, rows: NDArray[np.intp], priors: PointPriors) -> tuple[Array, Array, Array]:
        assert self._covariances is not None
        cam_from_ref = se3.inverse(frame.ref_from_cam)
        r = cam_from_ref[:3, :3]
        mean = se3.transform(cam_from_ref, priors.mean)
        known = (priors.information != 0).any(axis=(1, 2), keepdims=True)
        cov = np.linalg.inv(np.where(known, priors.information, np.eye(3)))
        j = point_in_cam_jacobian(mean)
        cov = r @ cov @ r.T + j @ self._covariances.cov_pose(0) @ np.swapaxes(j, 1, 2)
        information = np.where(known, np.linalg.inv(cov), 0.0)
        # The view from this very camera, linearised at the window's estimate of the points.
        in_cam = se3.transform(cam_from_ref, self._points[rows])
        views = _covering(self._views([frame], self._ids[rows]), len(rows))
        carried = PointPriors(mean, information)
        normal = NormalEquations.build(self._projection, np.eye(4)[None], in_cam, views, carried)
        reduced = normal.eliminate_points(np.array([False]))
        _, delta = reduced.solve(normal.g_point)
        return in_cam + delta, normal.v, cam_from_ref


class DepthFilter(CrossFrameWC):
    """The classical filter of one Gaussian a point: a window of one frame, whatever the configuration says."""

    name = "depth-filter"

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        one = msgspec.structs.replace(config.window, frames=1)
        super().__init__(projection, msgspec.structs.replace(config, window=one))


def _covering(views: Views, points: int) -> Views:
    """The same views, and one without information of every point that has none."""
    missing = np.setdiff1d(np.arange(points), views.point)
    n = len(missing)
    point = np.concatenate([views.point, missing])
    order = np.argsort(point, kind="stable")
    return Views(
        np.concatenate([views.frame, np.zeros(n, np.intp)])[order],
        point[order],
        np.concatenate([views.z_px, np.zeros((n, 4))])[order],
        np.concatenate([views.information, np.zeros((n, 4, 4))])[order],
    )
