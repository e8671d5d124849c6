"""Baseline: the extended Kalman filter over the pose and all visible points, on filterpy, in error-state form.

filterpy's filter is additive, so its state is the error, zero before each update, which is then injected into the pose
and the points. State: ξ of world_from_cam (6), then δX in the world (3 per point). No motion is assumed: the prediction
makes the pose unknown. With inertial samples, these predict it instead, and the 17 rows of `inertial/state.py` follow
the pose. There is one update per frame, linearised at the robust resection of the frame (`Ekf`) or at the
constant-velocity prediction (`EkfConstantVelocity`, the weaker usage). Solà, Simultaneous localization and mapping with
the extended Kalman filter, 2014.
"""

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import NDArray

from ... import core
from ...config import Config
from ...geometry import Array, se3
from ...geometry.linear import matvec, symmetric
from ...geometry.stereo import MIN_DEPTH, StereoProjection, clamp_depth
from ...record import changed
from ...types import Observations, Solution
from ..lifecycle import WorldPoints, frame_status, solution_of
from ..triangulation import counted_cov, triangulate, usable_births
from ..window.inertia.checks import inertial_estimate
from ..window.inertia.inertia import Inertia
from ..window.inertia.interval import JOINT, Known
from ..window.inertia.takes_samples import InertialMotionModel, TakesSamples
from .baseline import Baseline

# The pose is unknown before its update: its prior covariance is this multiple of the covariance that the views will
# give it, plus this multiple of that of the drift so far (otherwise each frame would seem to contain a little
# information about its position in the world). The first is a compromise between the information left in the prior, a
# ten-thousandth, and lost digits: the update subtracts such numbers.
_FREE, _FREE_OF_DRIFT = 1e4, 300.0


class Ekf(TakesSamples, Baseline):
    """Joint covariance of the pose (6), the inertial state (17 or none) and the m visible points; world-centred."""

    _at_prediction = False  # whether the update is linearised there, and not at the resection
    # Whether views count by how long their errors last, eq. (69), and not by their covariances alone.
    _lasting = False

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        super().__init__(projection, config)
        self.inertia = Inertia(config)
        self._motion = InertialMotionModel(config, self.inertia)
        self._own = 6  # number of rows before those of the points

    def step(self, observations: Observations) -> Solution:
        """Take the next frame; see `Estimator.step`."""
        self.inertia.take(observations.inertial, observations.stamp_ns)
        return self.by_inertia_if_lost(super().step(observations), observations.stamp_ns)

    def _begin(self, obs: Observations, first: Solution) -> WorldPoints:
        self._world_from_cam, self._cov, self._own = first.world_from_cam, first.cov_pose, 6
        self._ids, self._points = np.empty(0, np.int64), np.empty((0, 3))  # points in the world
        self._begin_inertia(obs.stamp_ns)
        self._add(obs)
        return self._in_world()

    def _advance(self, obs: Observations, before: WorldPoints) -> tuple[Solution, WorldPoints]:
        ended = self._drop(np.isin(self._ids, obs.track_ids))
        rows = np.searchsorted(obs.track_ids, self._ids)
        if obs.lasting.std_drift_px is not None:  # part of the prediction, so before the gate
            self._let_drift(obs.lasting.std_drift_px[rows])
        self._structure = WorldPoints.merge([ended, self._in_world()])
        found = self._initial_motion(obs, rows, *self._in_camera(), self._world_from_cam)
        if self._at_prediction:
            self._world_from_cam, _ = self._motion.predict(obs.stamp_ns)
        else:
            self._world_from_cam = se3.orthonormalise(self._world_from_cam @ se3.inverse(found.cam_from_ref))
        known = self._predict(obs, _FREE * found.cov_pose + _FREE_OF_DRIFT * self._cov[:6, :6])
        cov_px = counted_cov(obs, rows) if self._lasting else obs.cov_px[rows]
        self._update(obs.z_px[rows], cov_px, found.accepted, known)
        self._begin_inertia(obs.stamp_ns)
        rejected = self._ids[~found.accepted]
        self._add(obs)
        solution = solution_of(
            obs,
            frame_status(int(found.accepted.sum()), len(found.accepted), obs.note, self._robust, found),
            self._world_from_cam,
            self._cov[:6, :6].copy(),
            WorldPoints(self._ids, *self._in_camera()),
            self._in_world(),
            rejected_ids=rejected,
            iterations=1,
            nis=found.chi2,
            nis_dof=found.dof,
            # noise densities as given: this filter does not learn factors on them
            inertial=self.inertia.now and inertial_estimate(self.inertia.now, np.ones(3)),
        )
        return solution, ended

    def _in_world(self) -> WorldPoints:
        return WorldPoints(self._ids, self._points, _blocks(self._cov[self._own :, self._own :]).copy())

    def _drop(self, keep: NDArray[np.bool_]) -> WorldPoints:
        """Marginalise the points outside the mask, and return them."""
        ended = self._in_world().select(~keep)
        rows = np.concatenate([np.ones(self._own, bool), np.repeat(keep, 3)])
        self._ids, self._points, self._cov = self._ids[keep], self._points[keep], self._cov[rows][:, rows]
        return ended

    def _measurement(self, used: NDArray[np.intp], z_px: Array, cov_px: Array) -> tuple[Array, Array]:
        """Return innovations (3k,) of unit noise, and H (3k, n), of views (k, 4) of the points `used`.

        The four coordinates of a view contain three measurements of a point, as both image rows measure the same. After
        whitening they are rotated so that the fourth contains no information. A missing side contains none at all.
        """
        cam_from_world = se3.inverse(self._world_from_cam)
        in_cam = clamp_depth(se3.transform(cam_from_world, self._points[used]))
        white = core.whitening_of_views(z_px, cov_px)
        apart = matvec(white, np.nan_to_num(z_px) - self._projection.project(in_cam))
        turn, a = np.linalg.qr(white @ self._projection.jacobian(in_cam))
        h = np.zeros((len(used), 3, len(self._cov)))
        h[:, :, :6] = a @ se3.point_in_source_jacobian(in_cam)
        columns = self._own + 3 * used[:, None] + np.arange(3)
        h[np.arange(len(used))[:, None, None], np.arange(3)[:, None], columns[:, None, :]] = a @ cam_from_world[:3, :3]
        return matvec(np.swapaxes(turn, 1, 2), apart).ravel(), h.reshape(3 * len(used), -1)

    def _predict(self, obs: Observations, cov_free: Array) -> Known | None:
        """Predict pose and state by the samples since the last frame, and return them, eq. (81).

        If samples are missing, the pose becomes unknown, with the covariance `cov_free` (6, 6), the inertial state is
        dropped, and the result is None.
        """
        by = self.inertia.transition(obs.stamp_ns)
        if by is None or self.inertia.now is None:
            self._end_inertia()
            self._cov[:6], self._cov[:, :6] = 0.0, 0.0
            self._cov[:6, :6] = cov_free
            return None
        known, own = self.inertia.now.carried(by, obs.stamp_ns), self._own
        self._cov[:own] = by.rows @ self._cov[:own]
        self._cov[:, :own] = self._cov[:own].T
        # patches that slide alike cause an apparent rotation, eq. (17a), which the gyroscope does not measure
        known.cov[range(3, 6), range(3, 6)] += obs.lasting.std_turn_rad**2
        self._cov[:own, :own] = known.cov
        return known

    def _update(self, z_px: Array, cov_px: Array, accepted: NDArray[np.bool_], known: Known | None) -> None:
        """Update with filterpy's filter, eqs. (50), (51); `known`: the prediction by samples."""
        used = np.flatnonzero(accepted)
        innovation, h = self._measurement(used, z_px[used], cov_px[used])
        x = np.zeros(len(self._cov))
        if known is not None:
            x[:6] = se3.log(se3.inverse(self._world_from_cam) @ known.world_from_cam)
        x = self._filtered(x, innovation, h)
        self._world_from_cam = se3.orthonormalise(self._world_from_cam @ se3.exp(x[:6]))
        self._points = self._points + x[self._own :].reshape(-1, 3)
        if known is None:
            return
        now = changed(known, state=known.state + x[JOINT["state"]], world_from_cam=self._world_from_cam)
        self.inertia.now = changed(now, cov=self._cov[: self._own, : self._own].copy())

    def _filtered(self, x: Array, innovation: Array, h: Array) -> Array:
        """Return the error (n,) after an update with measurements (k,) of unit noise; the covariance is updated."""
        kf = ExtendedKalmanFilter(dim_x=len(x), dim_z=len(innovation))
        kf.x, kf.P = x, self._cov
        kf.update(innovation, HJacobian=lambda _: h, Hx=lambda x: h @ x)
        self._cov = symmetric(kf.P)
        return np.asarray(kf.x)

    def _begin_inertia(self, stamp_ns: int) -> None:
        """Add the predicted inertial state, or else an initial one, if there are samples."""
        if self._own > 6:
            return
        known = self.inertia.predicted(stamp_ns)
        if known is None:
            known = self.inertia.begun(stamp_ns, self._world_from_cam, self._cov[:6, :6])
        if known is None:
            self.inertia.now = None
            return
        n, self._own = len(self._cov) + len(known.state), JOINT.size
        joint, kept = np.zeros((n, n)), np.r_[:6, self._own : n]
        joint[: self._own, : self._own] = known.cov
        joint[np.ix_(kept, kept)] = self._cov
        self._cov = joint
        self.inertia.now = changed(known, cov=joint[: self._own, : self._own].copy())

    def _end_inertia(self) -> None:
        """Marginalise the inertial state."""
        kept = np.r_[:6, self._own : len(self._cov)]
        self._cov, self._own, self.inertia.now = self._cov[np.ix_(kept, kept)], 6, None

    def _let_drift(self, std_drift_px: Array) -> None:
        """Add process noise, m², across the ray and in depth."""
        p, r = self._projection, self._world_from_cam[:3, :3]
        in_cam = se3.transform(se3.inverse(self._world_from_cam), self._points)
        ray = in_cam / np.maximum(in_cam[:, 2:], MIN_DEPTH)
        along = in_cam[:, 2] ** 2 * std_drift_px / (p.f_px * p.baseline_m)
        across = in_cam[:, 2] * std_drift_px / p.f_px
        blocks = along[:, None, None] ** 2 * ray[:, :, None] * ray[:, None, :]
        blocks[:, [0, 1], [0, 1]] += across[:, None] ** 2
        _blocks(self._cov[self._own :, self._own :])[:] += r @ blocks @ r.T

    def _add(self, obs: Observations) -> None:
        """Add new points, correlated with the rest, eq. (52): X = T X_c, δX = R (J ξ + δX_c) with J = [I, −[X_c]×]."""
        new = usable_births(self._projection, obs.z_px, obs.cov_px) & ~np.isin(obs.track_ids, self._ids)
        in_cam, cov = triangulate(self._projection, obs.z_px[new], obs.cov_px[new])
        r = self._world_from_cam[:3, :3]
        g = (-r @ se3.point_in_source_jacobian(in_cam)).reshape(-1, 6)
        n, d = len(g), len(self._cov)
        joint = np.empty((d + n, d + n))
        joint[:d, :d] = self._cov
        joint[d:, :d] = g @ self._cov[:6]
        joint[:d, d:] = joint[d:, :d].T
        joint[d:, d:] = g @ self._cov[:6, :6] @ g.T
        _blocks(joint[d:, d:])[:] += r @ cov @ r.T
        order = np.argsort(together := np.concatenate([self._ids, obs.track_ids[new]]))
        rows = np.concatenate([np.arange(self._own), (self._own + 3 * order[:, None] + np.arange(3)).ravel()])
        self._ids, self._cov = together[order], joint[np.ix_(rows, rows)]
        self._points = np.concatenate([self._points, se3.transform(self._world_from_cam, in_cam)])[order]

    def _in_camera(self) -> tuple[Array, Array]:
        """Return points in the camera (m, 3) and covariances (m, 3, 3), eq. (45): δX_c = Rᵀ δX + [−I, [X_c]×] ξ."""
        cam_from_world = se3.inverse(self._world_from_cam)
        in_cam = se3.transform(cam_from_world, self._points)
        r, j = cam_from_world[:3, :3], se3.point_in_source_jacobian(in_cam)
        jt = np.swapaxes(j, 1, 2)
        cross = self._cov[self._own :, :6].reshape(-1, 3, 6)
        mixed = r @ cross @ jt
        cov = (
            r @ _blocks(self._cov[self._own :, self._own :]) @ r.T
            + mixed
            + np.swapaxes(mixed, 1, 2)
            + j @ self._cov[:6, :6] @ jt
        )
        return in_cam, symmetric(cov)


def _blocks(cov: Array) -> Array:
    """Return a view (m, 3, 3) of the blocks on the diagonal of (3m, 3m)."""
    m = len(cov) // 3
    return np.einsum("iaib->iab", cov.reshape(m, 3, m, 3))


class EkfLasting(Ekf):
    """The same filter with views weighted by how long their errors last, as in the window's filter, eq. (69)."""

    _lasting = True


class EkfConstantVelocity(Ekf):
    """The same filter linearised at the constant-velocity prediction: weaker if motion is uneven."""

    _at_prediction = True
