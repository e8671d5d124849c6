"""The cross-frame window: all motions of the last b frames estimated together, with a joint camera-centred prior.

State: the reference camera p is the newest frame that has left the window; frames p+1 … n are in it with poses
X_s = cam_s_from_ref; points are q in camera p (`inverse_depth`); the world is one more pose, carried by the prior.
One minimum gives both readings: CC structure and its covariance directly, WC pose and structure through the
world's own uncertainty. Source: Weng, Cui, Ahuja, sections 2 and 3; DESIGN section 2 for the form of the prior.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...geometry import se3
from ...geometry.gates import chi2_gates
from ...geometry.linear import symmetric
from ...geometry.resection import Resection
from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection, whitening_of_views
from ...types import Observations, Solution, Status
from ..ids import among
from ..lifecycle import few_views, open_map, solution_without_points, status_of
from ..motion_model import MotionPrior, robust_start
from .inverse_depth import CHART, Views, homogeneous_from_q, in_reference, linearise, q_jacobian, whitened_residuals
from .marginals import Reading, read_structure
from .normal_equations import System
from .prior import Prior

_DIVERGED = 1e3  # a step that promises more than this, and more than the last one, leads away from the minimum
# A step leaves less than a ten-thousandth of the decrease it promised (seen in simulated and real views): after one
# that promised this much, a third of a deviation at most is left, all variables together; the next frame steps on.
_CONVERGED = 1000.0
_STRIKES = 6  # a track rejected so often is never used again; one rejection at its second view is enough


@dataclass(slots=True)
class _Frame:
    """One frame of the window: views `z` (n, 4) of `ids` with their whitening `root` (n, 4, 4), of which `used` (n,)
    count, `stereo` (n,) with both sides; `var_drift` (n, 3) of q since the frame before, or (0, 3) for none."""

    index: int
    ids: NDArray[np.int64]
    z: Array
    root: Array
    stereo: NDArray[np.bool_]
    used: NDArray[np.bool_]
    var_drift: Array
    cam_from_ref: Array

    def views(self, ids: NDArray[np.int64], row: int) -> Views:
        """The used views, which are all of points `ids` (ascending), as views of frame `row`."""
        point = np.searchsorted(ids, self.ids[self.used])
        return Views(np.full(len(point), row), point, self.z[self.used], self.root[self.used])


class CrossFrame:
    """The default estimator (see `Estimator`)."""

    name = "cross-frame"

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        self.projection = projection
        self.config = config
        self.motion = MotionPrior(config.motion)
        self.prior: Prior | None = None
        self.frames: list[_Frame] = []
        self.ids = np.empty(0, np.int64)  # every point of the state, ascending
        self.q = np.empty((0, 3))
        self.charts = np.empty((0, 4, 4))  # ref_from_chart of each point
        self.y = np.empty(0)  # the prior's common modes
        self.reading: Reading | None = None
        self.strikes: dict[int, int] = {}

    def step(self, observations: Observations) -> Solution:
        """Take the next frame; see `Estimator.step`."""
        views = _Frame(
            observations.frame_index,
            observations.track_ids,
            np.nan_to_num(observations.z_px),
            whitening_of_views(observations.z_px, observations.cov_px),
            np.asarray(np.isfinite(observations.z_px).all(axis=1)),
            np.ones(len(observations.track_ids), bool),
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
        views.cam_from_ref = se3.orthonormalise(motion.cam_from_ref @ previous)
        self._enter(views, observations)
        iterations = self._minimise()
        return self._report(observations, motion, iterations)

    def _var_drift(self, observations: Observations) -> Array:
        """Drift of patches over their surfaces as variances of q (n, 3), eq. (33): rays, and disparity."""
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
        births = among(observations.track_ids, solution.track_ids)
        self.frames, self.strikes = [], {}
        self.ids = solution.track_ids
        self.q = self._q_of_views(observations.z_px[births])
        self.charts = np.broadcast_to(np.eye(4), (len(self.ids), 4, 4))
        views.used = births
        lin = linearise(self.projection, np.eye(4)[None], self.charts, self.q, views.views(self.ids, 0))
        cov = np.linalg.inv(lin.v)
        self.q = self.q + (cov @ lin.g_point[..., None])[..., 0]
        self.prior = Prior.of_views(self.ids, self.q, symmetric(cov), solution.world_from_cam, solution.cov_pose)
        self.y = np.zeros(6)
        self._improve(Views.none())
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
        frame, prior = self.frames.pop(0), self.prior
        x = frame.cam_from_ref
        # a point enters the prior with a stereo view: one side alone would leave its depth open
        frame.used &= frame.stereo | among(frame.ids, prior.ids)
        seen = frame.ids[frame.used]
        later = np.unique(np.concatenate([f.ids[f.used] for f in self.frames] or [seen]))
        prior = prior.keep(among(prior.ids, np.union1d(later, seen)))
        self.charts = se3.orthonormalise(x @ self.charts)  # from here on in the new reference camera
        lin = linearise(self.projection, np.eye(4)[None], self.charts, self.q, frame.views(self.ids, 0))
        at = np.searchsorted(self.ids, prior.ids)
        prior = prior.drifted(self._drift_in_charts(frame, prior.ids, at))
        prior = prior.absorbed(self.y, x, self.q[at], lin.v[at], lin.g_point[at])
        new = np.searchsorted(self.ids, np.setdiff1d(seen, prior.ids))
        cov = symmetric(np.linalg.inv(lin.v[new]))
        mean = self.q[new] + (cov @ lin.g_point[new][..., None])[..., 0]
        prior = prior.joined(self.ids[new], self.charts[new], mean, cov)
        self.prior = prior.keep(among(prior.ids, later)).condensed()
        self.y = np.zeros(self.prior.modes.shape[2])
        back = se3.inverse(x)
        if self.frames:
            cams = se3.orthonormalise(np.stack([f.cam_from_ref for f in self.frames]) @ back)
            for f, cam in zip(self.frames, cams, strict=True):
                f.cam_from_ref = cam
        self._keep(among(self.ids, np.union1d(later, self.prior.ids)))

    def _drift_in_charts(self, frame: _Frame, ids: NDArray[np.int64], at: NDArray[np.intp]) -> Array:
        """Covariances (n, 3, 3) of q of points, rows `at` of the state, for their drift up to a frame that is now the
        reference; zero where the frame does not see them."""
        cov = np.zeros((len(ids), 3, 3))
        known = among(ids, frame.ids)
        if not len(frame.var_drift) or not known.any():
            return cov
        charts = self.charts[at[known]]
        here = in_reference(charts, self.q[at[known]])
        chart_from_here = np.linalg.inv(q_jacobian(here) @ charts[:, :, CHART])
        drift = frame.var_drift[np.searchsorted(frame.ids, ids[known])]
        cov[known] = (chart_from_here * drift[:, None, :]) @ np.swapaxes(chart_from_here, 1, 2)
        return cov

    def _keep(self, rows: NDArray) -> None:
        """Points (mask or order) that stay in the state."""
        self.ids, self.q, self.charts = self.ids[rows], self.q[rows], self.charts[rows]

    def _enter(self, views: _Frame, observations: Observations) -> None:
        """The newest frame joins the window; points not yet in the state are triangulated from it."""
        self._strike(self.rejected)
        banned = self._banned(views.ids)
        known = among(views.ids, self.ids)
        new = ~known & views.stereo & ~banned
        views.used = (known | new) & ~banned & ~among(views.ids, self.rejected)
        back = se3.inverse(views.cam_from_ref)
        self.ids = np.concatenate([self.ids, views.ids[new]])
        self.q = np.concatenate([self.q, self._q_of_views(observations.z_px[new])])
        self.charts = np.concatenate([self.charts, np.broadcast_to(back, (int(new.sum()), 4, 4))])
        self._keep(np.argsort(self.ids))
        self.frames.append(views)

    def _strike(self, rejected: NDArray[np.int64]) -> None:
        """Remember who disagrees with the motion. Of a track with one view in the state, that view may be the wrong
        one: it is dropped."""
        assert self.prior is not None
        seen = np.array([among(rejected, f.ids) for f in self.frames], int)
        young = (seen.sum(0) <= 1) & ~among(rejected, self.prior.ids)
        for track_id, once in zip(rejected.tolist(), young.tolist(), strict=True):
            self.strikes[track_id] = _STRIKES if once else self.strikes.get(track_id, 0) + 1
        for f in self.frames:
            f.used &= ~among(f.ids, rejected[young])

    def _banned(self, ids: NDArray[np.int64]) -> NDArray[np.bool_]:
        return np.array([self.strikes.get(int(i), 0) >= _STRIKES for i in ids], bool)

    def _forget_strikes(self, alive: NDArray[np.int64]) -> None:
        present = set(alive.tolist())
        self.strikes = {i: n for i, n in self.strikes.items() if i in present}

    @property
    def world_from_ref(self) -> Array:
        """The world's origin as the prior's modes have it."""
        assert self.prior is not None
        return self.prior.world(self.y)

    def _drop_unseen(self) -> None:
        """Points leave the state that neither the prior nor an accepted stereo view of the window determines, and
        those that ended after a single view: it says nothing of anything else."""
        assert self.prior is not None
        at = np.concatenate([np.searchsorted(self.ids, f.ids[f.used]) for f in self.frames])
        stereo = np.concatenate([f.stereo[f.used] for f in self.frames])
        count = np.bincount(at, minlength=len(self.ids))
        keep = np.bincount(at[stereo], minlength=len(self.ids)) > 0
        keep &= (count > 1) | among(self.ids, self.frames[-1].ids)
        keep[np.searchsorted(self.ids, self.prior.ids)] = True
        if not keep.all():
            self._keep(keep)
            for f in self.frames:
                f.used &= among(f.ids, self.ids)

    def _q_of_views(self, z: Array) -> Array:
        """q of stereo views (n, 4) in the camera that saw them."""
        p = self.projection
        v = 0.5 * (z[:, 1] + z[:, 3])
        return np.stack([(z[:, 0] - p.cx_left_px) / p.f_px, (v - p.cy_px) / p.f_px, p.inverse_depth(z)], axis=1)

    # -- the minimum ------------------------------------------------------------------------------------------

    def _cams(self) -> Array:
        """Poses (F, 4, 4) of the window."""
        return np.stack([f.cam_from_ref for f in self.frames]) if self.frames else np.empty((0, 4, 4))

    def _views(self) -> Views:
        """Views of the window over all points of the state."""
        parts = [f.views(self.ids, row) for row, f in enumerate(self.frames)]
        return Views.joined(parts) if parts else Views.none()

    def _minimise(self) -> int:
        """Gauss-Newton to the joint minimum; views that contradict it have no part in the next step, of this frame or
        of the next one. The number of steps; the last factor stays for the covariances."""
        before, steps = np.inf, 0
        while steps < self.config.window.max_iterations and not before < _CONVERGED:
            self._drop_unseen()
            views = self._views()
            decrease = self._improve(views)
            if not decrease < max(before, _DIVERGED):
                raise np.linalg.LinAlgError("Gauss-Newton diverges")
            self._gate(views)
            before, steps = decrease, steps + 1
        return steps

    def _improve(self, views: Views) -> float:
        """One Gauss-Newton step of the whole window, and the decrease of the sum of squares that it promised."""
        assert self.prior is not None
        cams = self._cams()
        lin = linearise(self.projection, cams, self.charts, self.q, views)
        self.system = System(self.prior, np.searchsorted(self.ids, self.prior.ids), lin)
        dx, dq, dy, decrease = self.system.step(lin.g_pose, lin.g_point, self.q, self.y)
        for f, cam in zip(self.frames, se3.orthonormalise(se3.exp(dx) @ cams), strict=True):
            f.cam_from_ref = cam
        self.q, self.y = self.q + dq, self.y + dy
        return decrease

    def _gate(self, views: Views) -> None:
        """Take out the views of the window that the joint minimum contradicts."""
        r = whitened_residuals(self.projection, self._cams(), self.charts, self.q, views)[1]
        measured = np.count_nonzero(np.diagonal(views.root, axis1=1, axis2=2), axis=1)  # one side, or both
        bad = (r * r).sum(1) > chi2_gates(measured, self.config.robust.gate_probability)
        for row, track_id in zip(views.frame[bad].tolist(), self.ids[views.point[bad]].tolist(), strict=True):
            frame = self.frames[row]
            frame.used[np.searchsorted(frame.ids, track_id)] = False
            self.strikes[track_id] = self.strikes.get(track_id, 0) + 1

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
        status, reason = status_of(int(motion.accepted.sum()), observations.note, self.config.robust)
        assert before is not None
        ended = before.ended(~among(before.ids, self.ids))
        newest = self.frames[-1]
        world = self.world_from_ref
        show = among(reading.ids, newest.ids[newest.used]) & reading.finite
        return Solution(
            status=status,
            reason=reason,
            world_from_cam=reading.world_from_cam,
            cov_pose=reading.cov_pose,
            track_ids=reading.ids[show],
            points_in_cam=reading.points_in_cam[show],
            cov_points=reading.cov_points[show],
            points_in_world=reading.points_in_world[show],
            cov_points_in_world=reading.cov_points_in_world[show],
            window_frame_indices=np.array([f.index for f in self.frames], np.int64),
            window_world_from_cam=world @ se3.inverse(np.stack([f.cam_from_ref for f in self.frames])),
            rejected_ids=newest.ids[~newest.used],
            ended_ids=ended[0],
            ended_points_in_world=ended[1],
            ended_cov_points_in_world=ended[2],
            iterations=iterations,
            nis=motion.chi2,
            nis_dof=motion.dof,
        )
