"""The cross-frame window: all motions of the last b frames estimated together, with a joint camera-centred prior.

State: the reference camera p is the newest frame that has left the window; frames p+1 … n are in it with poses
X_s = cam_s_from_ref; points are q in camera p (`inverse_depth`); the world is one more pose, carried by the prior.
One minimum gives both readings: CC structure and its covariance directly, WC pose and structure through the
world's own uncertainty. Source: Weng, Cui, Ahuja, sections 2 and 3; DESIGN section 2 for the form of the prior.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from ..config import Config
from ..geometry import pose as se3
from ..geometry.pose import Array
from ..geometry.resection import Resection
from ..geometry.stereo import StereoProjection, information_of_views
from ..types import Observations, Solution, Status
from .inverse_depth import (
    CHART,
    gradients,
    homogeneous_from_q,
    in_reference,
    linearise,
    q_jacobian,
    view_residuals,
)
from .motion_prior import MotionPrior, robust_start
from .outcome import few_views, open_map, solution_without_points, status_of
from .prior import Prior
from .reading import Reading, read_structure
from .system import System

_DIVERGED = 1e3  # a step that promises more than this, and more than the last one, leads away from the minimum
_STRIKES = 6  # a track rejected so often is never used again; one rejection at its second view is enough


@dataclass(slots=True)
class _Frame:
    """One frame of the window; `info` (n, 4, 4) is zero for rejected views; `var_drift` (n, 3) of q since the frame
    before, or (0, 3) for none."""

    index: int
    ids: NDArray[np.int64]
    z: Array
    info: Array
    var_drift: Array
    cam_from_ref: Array


class CrossFrame:
    """The default estimator (see `Estimator`)."""

    name = "cross-frame"

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        self.projection = projection
        self.config = config
        self.gate = float(chdtri(4, 1 - config.robust.gate_probability))
        self.motion = MotionPrior(config.motion)
        self.prior: Prior | None = None
        self.frames: list[_Frame] = []
        self.ids = np.empty(0, np.int64)  # every point of the state, ascending
        self.q = np.empty((0, 3))
        self.charts = np.empty((0, 4, 4))  # ref_from_chart of each point
        self.world_from_ref = np.eye(4)
        self.reading: Reading | None = None
        self.strikes: dict[int, int] = {}

    def step(self, observations: Observations) -> Solution:
        """Take the next frame; see `Estimator.step`."""
        views = _Frame(
            observations.frame_index,
            observations.track_ids,
            np.nan_to_num(observations.z_px),
            information_of_views(observations.z_px, observations.cov_px),
            self._var_drift(observations),
            np.eye(4),
        )
        self._forget_strikes(observations.track_ids)
        if self.prior is None:
            return self._start(observations, views)
        try:
            return self._advance(observations, views)
        except np.linalg.LinAlgError:
            return self._lose(observations, "the points that are left do not determine the motion")

    def _advance(self, observations: Observations, views: _Frame) -> Solution:
        if len(self.frames) == self.config.window.frames:
            self._absorb_oldest()
        motion, reason = self._robust_motion(observations)
        if motion is None:
            return self._lose(observations, reason)
        previous = self.frames[-1].cam_from_ref if self.frames else np.eye(4)
        views.cam_from_ref = se3.orthonormalised(motion.cam_from_ref @ previous)
        self._enter(views, observations)
        iterations = self._optimise()
        if self._gate():
            iterations += self._optimise()
        return self._report(observations, motion, iterations)

    def _var_drift(self, observations: Observations) -> Array:
        """Drift of patches over their surfaces as variances of q (n, 3): both rays, and the disparity between them."""
        if observations.std_drift_px is None:
            return np.empty((0, 3))
        p = self.projection
        scale = np.array([1, 1, 1 / p.baseline_m]) / p.f_px
        return (observations.std_drift_px[:, None] * scale) ** 2

    # -- the map begins and ends ------------------------------------------------------------------------------

    def _start(self, observations: Observations, views: _Frame) -> Solution:
        """A new map in this camera: the world itself at the very first, else at the predicted pose."""
        solution = open_map(self.projection, self.config.robust, self.motion, observations)
        if not len(solution.track_ids):
            return solution
        births = np.isin(observations.track_ids, solution.track_ids)
        self.frames, self.strikes = [], {}
        self.ids, self.world_from_ref = solution.track_ids, solution.world_from_cam
        self.q = self._q_of_views(observations.z_px[births])
        self.charts = np.broadcast_to(np.eye(4), (len(self.ids), 4, 4))
        here = np.eye(4)[None]
        z, info = views.z[None, births], views.info[None, births]
        lin = linearise(self.projection, here, self.charts, self.q, z, info)
        prior = Prior.of_world(solution.world_from_cam, solution.cov_pose)
        self.prior = prior.with_views(self.ids, self.charts, self.q, self.world_from_ref, lin.v, lin.g_point)
        self._optimise()
        self._read()
        return solution

    def _lose(self, observations: Observations, reason: str) -> Solution:
        """No motion found: the pose is predicted and the map ends here."""
        pose, cov_pose = self.motion.predict(observations.stamp_ns)
        assert self.reading is not None
        ended = self.reading.ended(np.ones(len(self.reading.ids), bool))
        self.prior, self.reading = None, None
        return solution_without_points(observations, Status.LOST, reason, pose, cov_pose, ended)

    def _robust_motion(self, observations: Observations) -> tuple[Resection | None, str]:
        """cam_n_from_cam_{n−1} from the local structure of the previous frame, or the reason why there is none."""
        robust, reading = self.config.robust, self.reading
        assert reading is not None
        _, at, of = np.intersect1d(observations.track_ids, reading.ids, return_indices=True)
        usable = ~self._banned(observations.track_ids[at])
        at, of = at[usable], of[usable]
        self.rejected = np.empty(0, np.int64)
        if len(at) < robust.min_views:
            return None, few_views(0, len(at), robust)
        points = homogeneous_from_q(reading.q_in_cam[of])
        cov = np.zeros((len(of), 4, 4))
        cov[:, CHART[:, None], CHART] = reading.cov_q_in_cam[of]
        var_drift = self._var_drift(observations)
        if len(var_drift):
            cov[:, CHART, CHART] += var_drift[at]
        predicted = se3.inverse(self.motion.predict(observations.stamp_ns)[0]) @ reading.world_from_cam
        starts = [predicted, np.eye(4)]
        if observations.cam_from_previous is not None:
            starts.insert(0, observations.cam_from_previous)
        found = robust_start(
            self.projection,
            points,
            cov,
            observations.z_px[at],
            observations.cov_px[at],
            starts,
            robust.gate_probability,
            robust.min_views,
        )
        if found is None:
            return None, f"no motion agrees with {robust.min_views} of the {len(at)} tracked points"
        self.rejected = observations.track_ids[at[~found.accepted]]
        return found, ""

    # -- the window moves -------------------------------------------------------------------------------------

    def _absorb_oldest(self) -> None:
        """The oldest frame becomes the reference; what all frames before it say becomes the new prior."""
        assert self.prior is not None
        frame = self.frames.pop(0)
        x = frame.cam_from_ref
        # a point enters the prior with a stereo view: one side alone would leave its depth open
        frame.info[(frame.info[:, 2, 2] == 0) & ~np.isin(frame.ids, self.prior.ids)] = 0
        seen = frame.info.any(axis=(1, 2))
        later = np.unique(
            np.concatenate([f.ids[f.info.any(axis=(1, 2))] for f in self.frames] + [np.empty(0, int)])
        )
        if not self.frames:
            later = frame.ids[seen]
        prior = self.prior.with_views(
            *self._of_prior(), np.zeros((len(self.prior.ids), 3, 3)), np.zeros((len(self.prior.ids), 3))
        )
        prior = prior.without(~np.isin(prior.ids, np.union1d(later, frame.ids[seen]))).in_camera(x)
        ids = np.union1d(prior.ids, frame.ids[seen])
        at = np.searchsorted(self.ids, ids)
        self.charts = se3.orthonormalised(x @ self.charts)  # from here on in the new reference camera
        charts, q = self.charts[at], self.q[at]
        z, info = _rows(ids, frame)
        lin = linearise(self.projection, np.eye(4)[None], charts, q, z[None], info[None])
        self.world_from_ref = prior.world_from_ref
        if len(frame.var_drift):
            known = np.isin(prior.ids, frame.ids)
            here = in_reference(prior.charts[known], prior.q[known])
            chart_from_here = np.linalg.inv(q_jacobian(here) @ prior.charts[known][:, :, CHART])
            drift = frame.var_drift[np.searchsorted(frame.ids, prior.ids[known])]
            cov = np.zeros((len(prior.ids), 3, 3))
            cov[known] = (chart_from_here * drift[:, None, :]) @ np.swapaxes(chart_from_here, 1, 2)
            prior = prior.with_drift(cov)
        prior = prior.with_views(ids, charts, q, self.world_from_ref, lin.v, lin.g_point)
        self.prior = prior.without(~np.isin(ids, later))
        self._keep(np.isin(self.ids, np.union1d(later, self.prior.ids)))
        back = se3.inverse(x)
        for f in self.frames:
            f.cam_from_ref = se3.orthonormalised(f.cam_from_ref @ back)
        self._drop_unseen()

    def _of_prior(self) -> tuple[NDArray[np.int64], Array, Array, Array]:
        assert self.prior is not None
        at = np.searchsorted(self.ids, self.prior.ids)
        return self.prior.ids, self.charts[at], self.q[at], self.world_from_ref

    def _keep(self, rows: NDArray) -> None:
        """Points (mask or order) that stay in the state."""
        self.ids, self.q, self.charts = self.ids[rows], self.q[rows], self.charts[rows]

    def _enter(self, views: _Frame, observations: Observations) -> None:
        """The newest frame joins the window; points not yet in the state are triangulated from it."""
        for i in self.rejected:
            self._strike(int(i))
        banned = self._banned(views.ids)
        known = np.isin(views.ids, self.ids)
        stereo = np.isfinite(observations.z_px).all(axis=1)
        new = ~known & stereo & ~banned
        views.info[np.isin(views.ids, self.rejected) | banned | (~known & ~new)] = 0
        back = se3.inverse(views.cam_from_ref)
        self.ids = np.concatenate([self.ids, views.ids[new]])
        self.q = np.concatenate([self.q, self._q_of_views(observations.z_px[new])])
        self.charts = np.concatenate([self.charts, np.broadcast_to(back, (int(new.sum()), 4, 4))])
        self._keep(np.argsort(self.ids))
        self.frames.append(views)

    def _strike(self, track_id: int) -> None:
        views = sum(int((f.ids == track_id).any()) for f in self.frames)
        in_prior = self.prior is not None and track_id in self.prior.ids
        young = views <= 1 and not in_prior
        self.strikes[track_id] = _STRIKES if young else self.strikes.get(track_id, 0) + 1
        if self.strikes[track_id] >= _STRIKES and young:  # its only view may be the wrong one
            for f in self.frames:
                f.info[f.ids == track_id] = 0
            self._drop_unseen()

    def _banned(self, ids: NDArray[np.int64]) -> NDArray[np.bool_]:
        return np.array([self.strikes.get(int(i), 0) >= _STRIKES for i in ids], bool)

    def _forget_strikes(self, alive: NDArray[np.int64]) -> None:
        present = set(alive.tolist())
        self.strikes = {i: n for i, n in self.strikes.items() if i in present}

    def _drop_unseen(self) -> None:
        """Points leave the state that neither the prior nor an accepted stereo view of the window determines."""
        assert self.prior is not None
        used = np.concatenate([self.prior.ids, *(f.ids[f.info[:, 2, 2] > 0] for f in self.frames)])
        keep = np.isin(self.ids, used)
        self._keep(keep)
        for f in self.frames:
            f.info[~np.isin(f.ids, self.ids)] = 0

    def _q_of_views(self, z: Array) -> Array:
        """q of stereo views (n, 4) in the camera that saw them."""
        p = self.projection
        v = 0.5 * (z[:, 1] + z[:, 3])
        return np.stack([(z[:, 0] - p.cx_left_px) / p.f_px, (v - p.cy_px) / p.f_px, p.inverse_depth(z)], axis=1)

    # -- the minimum ------------------------------------------------------------------------------------------

    def _views(self) -> tuple[Array, Array, Array]:
        """Poses (F, 4, 4), z (F, P, 4) and info (F, P, 4, 4) of the window over all points of the state."""
        if not self.frames:
            n = len(self.ids)
            return np.empty((0, 4, 4)), np.empty((0, n, 4)), np.empty((0, n, 4, 4))
        rows = [_rows(self.ids, f) for f in self.frames]
        cams = np.stack([f.cam_from_ref for f in self.frames])
        return cams, np.stack([r[0] for r in rows]), np.stack([r[1] for r in rows])

    def _optimise(self) -> int:
        """Gauss-Newton to the joint minimum, with one factor for all steps: the start is within a few σ, so that a
        fresh factor (most of a frame's time) would change a step by a few percent and the minimum not at all.
        The factor stays for the covariances.
        """
        assert self.prior is not None
        cams, z, info = self._views()
        lin = linearise(self.projection, cams, self.charts, self.q, z, info)
        self.system = System(self.prior, self.ids, lin)
        g_pose, g_point, iterations, before = lin.g_pose, lin.g_point, 0, np.inf
        while True:
            gradient = self.prior.gradient(*self._of_prior()[2:])
            dx, dq, dw, decrease = self.system.step(g_pose, g_point, gradient)
            if not decrease < max(before, _DIVERGED):
                raise np.linalg.LinAlgError("Gauss-Newton diverges")
            before = decrease
            cams = se3.exp(dx) @ cams
            self.q = self.q + dq
            self.world_from_ref = self.world_from_ref @ se3.exp(dw)
            iterations += 1
            if decrease < 1e-2 or iterations == self.config.window.max_iterations:
                break
            g_pose, g_point = gradients(self.projection, cams, self.charts, self.q, z, info)
        for f, cam in zip(self.frames, cams, strict=True):
            f.cam_from_ref = se3.orthonormalised(cam)
        self.world_from_ref = se3.orthonormalised(self.world_from_ref)
        return iterations

    def _gate(self) -> bool:
        """Drop views of the window that the joint minimum contradicts; True when there were any."""
        cams, z, info = self._views()
        chi2 = view_residuals(self.projection, cams, self.charts, self.q, z, info)[2]
        bad = chi2 > self.gate
        for f, row in zip(self.frames, bad, strict=True):
            for track_id in self.ids[row]:
                f.info[f.ids == track_id] = 0
                self.strikes[int(track_id)] = self.strikes.get(int(track_id), 0) + 1
        self._drop_unseen()
        return bool(bad.any())

    # -- the readings -----------------------------------------------------------------------------------------

    def _read(self) -> Reading:
        cam_from_ref = self.frames[-1].cam_from_ref if self.frames else np.eye(4)
        newest = len(self.frames) - 1
        self.reading = read_structure(
            self.system, self.ids, self.charts, self.q, self.world_from_ref, cam_from_ref, newest
        )
        return self.reading

    def _report(self, observations: Observations, motion: Resection, iterations: int) -> Solution:
        before = self.reading
        reading = self._read()
        self.motion.record(observations.stamp_ns, reading.world_from_cam, reading.cov_pose)
        status, reason = status_of(int(motion.accepted.sum()), self.config.robust)
        assert before is not None
        ended = before.ended(~np.isin(before.ids, self.ids))
        newest = self.frames[-1]
        used = newest.info.any(axis=(1, 2))
        show = np.isin(reading.ids, newest.ids[used]) & reading.finite
        return Solution(
            status=status,
            reason="; ".join(text for text in (reason, observations.note) if text),
            world_from_cam=reading.world_from_cam,
            cov_pose=reading.cov_pose,
            track_ids=reading.ids[show],
            points_in_cam=reading.points_in_cam[show],
            cov_points=reading.cov_points[show],
            points_in_world=reading.points_in_world[show],
            cov_points_in_world=reading.cov_points_in_world[show],
            window_frame_indices=np.array([f.index for f in self.frames], np.int64),
            window_world_from_cam=np.stack(
                [self.world_from_ref @ se3.inverse(f.cam_from_ref) for f in self.frames]
            ),
            rejected_ids=newest.ids[~used],
            ended_ids=ended[0],
            ended_points_in_world=ended[1],
            ended_cov_points_in_world=ended[2],
            iterations=iterations,
            nis=motion.chi2,
            nis_dof=motion.dof,
        )


def _rows(ids: NDArray[np.int64], frame: _Frame) -> tuple[Array, Array]:
    """z (P, 4) and info (P, 4, 4) of one frame spread over the points `ids`; zero where unseen."""
    z, info = np.zeros((len(ids), 4)), np.zeros((len(ids), 4, 4))
    known = np.isin(frame.ids, ids)
    at = np.searchsorted(ids, frame.ids[known])
    z[at], info[at] = frame.z[known], frame.info[known]
    return z, info
