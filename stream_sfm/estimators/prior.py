"""The joint prior of the window: what all frames that left it say about points and world, in the reference camera.

A quadratic over [q of N points (3N), ω of world_from_ref (6)] around a frozen linearisation point,
½ δᵀΛδ − ηᵀδ. Camera-centred: the world's origin is one more pose in the state, so nothing that touches the prior
is ever relinearised in world coordinates, and the unobservable directions stay unobservable (DESIGN: bias grows
with n otherwise). ω is the right perturbation of world_from_ref.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry import pose as se3
from ..geometry.pose import Array
from .inverse_depth import CHART, homogeneous_from_q, pose_jacobian, q_from_homogeneous, q_jacobian
from .linear import Cholesky, marginalised, symmetric

# The very first camera is the world: known to a micrometre and a microradian, far below any estimate.
KNOWN = 1e-12


@dataclass(frozen=True, slots=True)
class Prior:
    """`ids` (N,) ascending; `q` (N, 3) and `world_from_ref` (4, 4): linearisation point; `information`
    (3N+6, 3N+6); `eta` (3N+6,)."""

    ids: NDArray[np.int64]
    q: Array
    world_from_ref: Array
    information: Array
    eta: Array

    @classmethod
    def of_world(cls, world_from_ref: Array, cov_pose: Array) -> "Prior":
        """Knows nothing but the pose of the reference camera."""
        cov = cov_pose + KNOWN * np.eye(6)
        scale = 1 / np.sqrt(np.diag(cov))
        info = np.linalg.inv(cov * np.outer(scale, scale)) * np.outer(scale, scale)
        return cls(np.empty(0, np.int64), np.empty((0, 3)), world_from_ref, symmetric(info), np.zeros(6))

    def gradient(self, q: Array, world_from_ref: Array) -> Array:
        """η − Λδ at the state (N, 3), (4, 4): the right-hand side of a Gauss-Newton step."""
        omega = se3.log(se3.inverse(self.world_from_ref) @ world_from_ref)
        return self.eta - self.information @ np.concatenate([(q - self.q).ravel(), omega])

    def with_views(self, ids: NDArray[np.int64], q: Array, world_from_ref: Array, v: Array, g: Array) -> "Prior":
        """The prior at a new linearisation point, with views from the reference camera itself added.

        `ids` (N',) ascending, a superset of this prior's; `q` (N', 3), `v` (N', 3, 3), `g` (N', 3): information
        and right-hand side of those views (zero for points without a view).
        """
        n = len(ids)
        old = np.searchsorted(ids, self.ids)
        at = np.concatenate([(3 * old[:, None] + np.arange(3)).ravel(), 3 * n + np.arange(6)])
        info = np.zeros((3 * n + 6, 3 * n + 6))
        eta = np.zeros(3 * n + 6)
        info[np.ix_(at, at)] = self.information
        eta[at] = self.gradient(q[old], world_from_ref)
        blocks = info[: 3 * n, : 3 * n].reshape(n, 3, n, 3)
        blocks[np.arange(n), :, np.arange(n), :] += v
        eta[: 3 * n] += g.ravel()
        return Prior(ids, q, world_from_ref, info, eta)

    def without(self, gone: NDArray[np.bool_]) -> "Prior":
        """Points (N,) bool marginalised."""
        if not gone.any():
            return self
        drop = np.concatenate([np.repeat(gone, 3), np.zeros(6, bool)])
        info, eta = marginalised(self.information, self.eta, drop)
        return Prior(self.ids[~gone], self.q[~gone], self.world_from_ref, info, eta)

    def with_drift(self, var_q: Array) -> "Prior":
        """Points that have moved since by independent steps of variance (N, 3): (Λ⁻¹ + Q)⁻¹ on their part.

        With C = Λ_mm + Q⁻¹: Λ'_mm = Q⁻¹ − Q⁻¹C⁻¹Q⁻¹, Λ'_mw = Q⁻¹C⁻¹Λ_mw, Λ'_ww = Λ_ww − Λ_wm C⁻¹ Λ_mw.
        """
        m = 3 * len(self.ids)
        info = self.information
        # steps far below what the prior knows change nothing and would cost digits
        q_inv = 1 / np.maximum(var_q.ravel(), 1e-6 / np.diag(info)[:m])
        c = info[:m, :m].copy()
        c[np.diag_indices(m)] += q_inv
        inverse = Cholesky(c).inverse()
        gain = q_inv[:, None] * inverse  # Q⁻¹C⁻¹
        new = np.empty_like(info)
        new[:m, :m] = -gain * q_inv
        new[np.diag_indices(m)] += q_inv
        new[:m, m:] = gain @ info[:m, m:]
        new[m:, :m] = new[:m, m:].T
        solved = inverse @ np.concatenate([info[:m, m:], self.eta[:m, None]], axis=1)
        new[m:, m:] = symmetric(info[m:, m:] - info[m:, :m] @ solved[:, :-1])
        eta = np.concatenate([q_inv * solved[:, -1], self.eta[m:] - info[m:, :m] @ solved[:, -1]])
        return Prior(self.ids, self.q, self.world_from_ref, new, eta)

    def in_camera(self, cam_from_ref: Array) -> "Prior":
        """The prior re-expressed in another camera whose pose is unknown to it: that pose is marginalised.

        With P' = X P and world_from_cam = world_from_ref X⁻¹, to first order in (δq', ξ, ω'):
        δq = M⁻¹(δq' − K'G ξ), ω = Ad(X⁻¹)(ω' + ξ), M = K' X E. The result is invariant under ξ: it knows the
        shape of points and world, not where the new camera stands. Its own views must be added next
        (`with_views`) or it stays singular.
        """
        n = len(self.ids)
        in_cam = homogeneous_from_q(self.q) @ cam_from_ref.T
        k = q_jacobian(in_cam)
        m_inv = np.linalg.inv(k @ cam_from_ref[:, CHART])
        ad = se3.adjoint(se3.inverse(cam_from_ref))
        info, eta = _congruence(self.information, self.eta, m_inv, ad)
        # columns of ξ: −K'G for the points, identity for the world, after the congruence above
        shift = np.concatenate([-(k @ pose_jacobian(in_cam)).reshape(3 * n, 6), np.eye(6)])
        cross = info @ shift
        joint = np.block([[info, cross], [cross.T, shift.T @ cross]])
        drop = np.concatenate([np.zeros(3 * n + 6, bool), np.ones(6, bool)])
        info, eta = marginalised(joint, np.concatenate([eta, shift.T @ eta]), drop)
        world_from_cam = se3.orthonormalised(self.world_from_ref @ se3.inverse(cam_from_ref))
        return Prior(self.ids, q_from_homogeneous(in_cam), world_from_cam, info, eta)


def _congruence(information: Array, eta: Array, point_blocks: Array, world_block: Array) -> tuple[Array, Array]:
    """Jᵀ Λ J and Jᵀ η for J = blockdiag(point blocks (N, 3, 3), world block (6, 6))."""
    n = len(point_blocks)
    size = 3 * n + 6

    def left(matrix: Array) -> Array:
        top = np.swapaxes(point_blocks, 1, 2) @ matrix[: 3 * n].reshape(n, 3, -1)
        return np.concatenate([top.reshape(3 * n, -1), world_block.T @ matrix[3 * n :]])

    half = left(information)
    return symmetric(left(half.T)), left(eta[:, None]).reshape(size)
