"""Baseline: the strongest filter, an iterated EKF in the newest camera, over inverse depths and the world's pose.

State: the points q = (X/Z, Y/Z, 1/Z) in the newest camera, in which their views are nearly linear, and ω, the error of
world_from_cam on the right, which no view depends on: it is carried in the joint covariance, so that iterating gains no
information about where the world is. The motion of a frame is free (no prior at all), and the update is iterated:
Gauss-Newton on the frame's views and the joint prior (Bell and Cathey, The iterated Kalman filter update as a
Gauss-Newton method, 1993), in covariance form. Then everything is carried into the new camera. It is the window with
b = 1 in another notation; its linearisation of older views is what the window can still correct. The equations are in
docs/mathematics.md, section 9.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...geometry import se3
from ...geometry.linear import Cholesky, matvec, symmetric
from ...geometry.resection import Resection
from ...geometry.se3 import Array
from ...geometry.stereo import KNOWN_DEPTH_SIGMAS, StereoProjection, clamp_depth
from ...types import Observations
from ..cross_frame.inverse_depth import (
    Q_COLUMNS,
    homogeneous_from_q,
    metric_jacobian,
    pose_jacobian,
    q_from_homogeneous,
    q_jacobian,
    q_of_views,
)
from ..lifecycle import WorldPoints
from ..triangulation import counted_cov
from .joint_filter import JointFilter, Structure

_MAX_ITERATIONS = 6  # measured: two to four are needed with 1 px of noise
_CONVERGED = 1e-3  # squared length of a step in standard deviations of the motion


class _Update(NamedTuple):
    """The frame's motion, and the state after its views.

    `x` (6 + 3m,): ω and q, with covariance `cov`; `cov_motion` (6, 6) of ξ in Exp(ξ) cam_from_previous, and `cross`
    (6 + 3m, 6) between both.
    """

    cam_from_previous: Array
    x: Array
    cov: Array
    cov_motion: Array
    cross: Array
    iterations: int


class IteratedEkf(JointFilter):
    """Joint covariance of the world and the visible points; camera-centred."""

    name = "iterated-ekf"

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        super().__init__(projection, config)
        self._q = np.empty((0, 3))

    def _drop(self, keep: NDArray[np.bool_]) -> WorldPoints:
        """Marginalise the points outside the mask; return those that have a position in metres."""
        ids, points, covs = self._in_world()
        gone = ~keep & self._finite()
        rows = np.concatenate([np.ones(6, bool), np.repeat(keep, 3)])
        self._ids, self._q, self._cov = self._ids[keep], self._q[keep], self._cov[rows][:, rows]
        return WorldPoints(ids[gone], points[gone], covs[gone])

    def _let_drift(self, std_drift_px: Array) -> None:
        scale = np.array([1, 1, 1 / self._projection.baseline_m]) / self._projection.f_px
        self._cov[np.diag_indices_from(self._cov)] += np.concatenate(
            [np.zeros(6), ((std_drift_px[:, None] * scale) ** 2).ravel()]
        )

    def _in_previous(self) -> tuple[Array, Array]:
        cov = np.zeros((len(self._q), 4, 4))
        cov[:, Q_COLUMNS[:, None], Q_COLUMNS] = self._blocks()
        return homogeneous_from_q(self._q), cov

    def _linearise(self, cam_from_previous: Array, q: Array) -> tuple[Array, Array, Array]:
        """Return the views h (n, 4) of q (n, 3), with ∂h/∂q (n, 4, 3) and ∂h/∂ξ (n, 4, 6), eqs. (9), (21) and (25)."""
        in_cam = clamp_depth(homogeneous_from_q(q) @ cam_from_previous.T)
        a = self._projection.jacobian_homogeneous(in_cam)
        by_q = a @ cam_from_previous[:, Q_COLUMNS]
        return self._projection.project_homogeneous(in_cam), by_q, a @ pose_jacobian(in_cam)

    def _take(self, obs: Observations, rows: NDArray[np.intp], found: Resection, predicted: Array) -> int:
        used = np.flatnonzero(found.accepted)
        update = self._update(obs.z_px[rows[used]], counted_cov(obs, rows[used]), used, found.cam_from_ref)
        self._carry_over(update)
        return update.iterations

    def _update(self, z_px: Array, cov_px: Array, used: NDArray[np.intp], cam_from_previous: Array) -> _Update:
        """Iterate the update with the views (k, 4) of the points `used` (k,)."""
        seen = np.isfinite(z_px).ravel()
        columns = 6 + (3 * used[:, None] + np.arange(3)).ravel()
        prior_q, q = self._q[used], self._q[used]
        iterations, far = 0, True
        while far and iterations < _MAX_ITERATIONS:
            iterations += 1
            views, by_q, by_motion = self._linearise(cam_from_previous, q)
            innovation = (z_px - views + matvec(by_q, q - prior_q)).ravel()[seen]
            j = by_motion.reshape(-1, 6)[seen]
            cross_views = _times_transposed(self._cov[:, columns], by_q)[:, seen]  # P Hᵀ
            s = _times_transposed(cross_views[columns].T, by_q)[:, seen] + _block_diagonal(cov_px)[seen][:, seen]
            root = Cholesky(symmetric(s)).root.T
            white_j, white_views = root @ j, root @ cross_views.T
            motion = Cholesky(white_j.T @ white_j)
            white = root @ innovation
            step = motion.solve(white_j.T @ white)
            x = white_views.T @ (white - white_j @ step)
            cam_from_previous = se3.orthonormalise(se3.exp(step) @ cam_from_previous)
            q = prior_q + x[columns].reshape(-1, 3)
            far = float(step @ (white_j.T @ (white_j @ step))) > _CONVERGED
        cov_motion = motion.inverse()
        gain = white_views.T @ white_j
        return _Update(
            cam_from_previous,
            x,
            self._cov - white_views.T @ white_views + gain @ cov_motion @ gain.T,
            cov_motion,
            -gain @ cov_motion,
            iterations,
        )

    def _carry_over(self, update: _Update) -> None:
        """Inject the state, and express it in the new camera."""
        motion = update.cam_from_previous
        homogeneous = homogeneous_from_q(self._q + update.x[6:].reshape(-1, 3))
        in_cam = clamp_depth(homogeneous @ motion.T)
        k = q_jacobian(in_cam)
        d, e = k @ motion[:, Q_COLUMNS], (k @ pose_jacobian(in_cam)).reshape(-1, 6)
        ad, n = se3.adjoint(motion), len(in_cam)
        turned = np.empty_like(update.cov)  # D P, then D P Dᵀ, D block-diagonal
        turned[:6], turned[6:] = ad @ update.cov[:6], (d @ update.cov[6:].reshape(n, 3, -1)).reshape(3 * n, -1)
        carried = np.empty_like(turned)
        carried[:, :6] = turned[:, :6] @ ad.T
        carried[:, 6:] = _times_transposed(turned[:, 6:], d)
        cross = np.concatenate([ad @ update.cross[:6], (d @ update.cross[6:].reshape(n, 3, 6)).reshape(3 * n, 6)])
        by_motion = np.concatenate([-np.eye(6), e])
        mixed = cross @ by_motion.T
        self._cov = symmetric(carried + mixed + mixed.T + by_motion @ update.cov_motion @ by_motion.T)
        world_from_previous = self._world_from_cam @ se3.exp(update.x[:6])
        self._world_from_cam = se3.orthonormalise(world_from_previous @ se3.inverse(motion))
        self._q = q_from_homogeneous(in_cam)

    def _add(self, obs: Observations) -> None:
        """Add new points; in their own camera they are independent of all else."""
        new = np.isfinite(obs.z_px).all(axis=1) & ~np.isin(obs.track_ids, self._ids)
        n, d = 3 * int(new.sum()), len(self._cov)
        joint = np.zeros((d + n, d + n))
        joint[:d, :d] = self._cov
        q = q_of_views(self._projection, obs.z_px[new])
        joint[d:, d:] = _block_diagonal(self._cov_of_births(q, obs.cov_px[new]))
        order = self._insert(obs.track_ids[new], joint)
        self._q = np.concatenate([self._q, q])[order]

    def _cov_of_births(self, q: Array, cov_px: Array) -> Array:
        """Covariances (n, 3, 3) of q of single views, eq. (12)."""
        a = self._projection.jacobian_homogeneous(homogeneous_from_q(q))[:, :, Q_COLUMNS]
        return np.asarray(np.linalg.inv(np.swapaxes(a, 1, 2) @ np.linalg.inv(cov_px) @ a))

    def _finite(self) -> NDArray[np.bool_]:
        """Whether each point has a position in metres."""
        return np.asarray(self._q[:, 2] > KNOWN_DEPTH_SIGMAS * np.sqrt(self._blocks()[:, 2, 2]))

    def _in_camera(self) -> tuple[Array, Array]:
        """Points (m, 3) in metres and ∂X/∂q (m, 3, 3); without meaning where they are not finite."""
        homogeneous = homogeneous_from_q(self._q)
        homogeneous[~self._finite(), 3] = 1.0
        return homogeneous[:, :3] / homogeneous[:, 3:], metric_jacobian(homogeneous)[..., Q_COLUMNS]

    def _in_world(self) -> tuple[NDArray[np.int64], Array, Array]:
        """Ids, points (m, 3) in the world and covariances: δX_w = R ([I, −[X]×] ω + δX)."""
        points, by_q = self._in_camera()
        r, j = self._world_from_cam[:3, :3], -se3.point_in_source_jacobian(points)
        mixed = by_q @ self._cov[6:, :6].reshape(-1, 3, 6) @ np.swapaxes(j, 1, 2)
        cov = by_q @ self._blocks() @ np.swapaxes(by_q, 1, 2) + mixed + np.swapaxes(mixed, 1, 2)
        cov = r @ (cov + j @ self._cov[:6, :6] @ np.swapaxes(j, 1, 2)) @ r.T
        return self._ids, se3.transform(self._world_from_cam, points), symmetric(cov)

    def _structure(self) -> Structure:
        finite = self._finite()
        points, by_q = self._in_camera()
        cov_points = symmetric(by_q @ self._blocks() @ np.swapaxes(by_q, 1, 2))
        ids, in_world, cov_in_world = self._in_world()
        return Structure(ids[finite], points[finite], cov_points[finite], in_world[finite], cov_in_world[finite])


def _block_diagonal(blocks: Array) -> Array:
    """The matrix (kn, kn) of blocks (n, k, k)."""
    n, k, _ = blocks.shape
    full = np.zeros((n, k, n, k))
    full[np.arange(n), :, np.arange(n), :] = blocks
    return full.reshape(n * k, n * k)


def _times_transposed(left: Array, blocks: Array) -> Array:
    """The product (a, nk) of `left` (a, 3n) and the transpose of the block-diagonal matrix of `blocks` (n, k, 3)."""
    n, k, _ = blocks.shape
    of_blocks = np.moveaxis(left.reshape(len(left), n, 3), 1, 0) @ np.swapaxes(blocks, 1, 2)  # (n, a, k)
    return np.moveaxis(of_blocks, 0, 1).reshape(len(left), n * k)
