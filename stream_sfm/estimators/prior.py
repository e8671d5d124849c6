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
from .inverse_depth import homogeneous_from_q, in_reference, pose_jacobian, q_jacobian
from .linear import Cholesky, marginalised, symmetric

# The very first camera is the world: known to a micrometre and a microradian, far below any estimate.
KNOWN = 1e-12


@dataclass(frozen=True, slots=True)
class Prior:
    """`ids` (N,) ascending; `charts` (N, 4, 4); `q` (N, 3) and `world_from_ref` (4, 4): linearisation point;
    `information` (3N+6, 3N+6); `eta` (3N+6,)."""

    ids: NDArray[np.int64]
    charts: Array
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
        return cls(
            np.empty(0, np.int64),
            np.empty((0, 4, 4)),
            np.empty((0, 3)),
            world_from_ref,
            symmetric(info),
            np.zeros(6),
        )

    def gradient(self, q: Array, world_from_ref: Array) -> Array:
        """η − Λδ at the state (N, 3), (4, 4): the right-hand side of a Gauss-Newton step."""
        omega = se3.log(se3.inverse(self.world_from_ref) @ world_from_ref)
        return self.eta - self.information @ np.concatenate([(q - self.q).ravel(), omega])

    def with_views(
        self, ids: NDArray[np.int64], charts: Array, q: Array, world_from_ref: Array, v: Array, g: Array
    ) -> "Prior":
        """The prior at a new linearisation point, with views from the reference camera itself added.

        `ids` (N',) ascending, a superset of this prior's; `charts` (N', 4, 4), `q` (N', 3); `v` (N', 3, 3) and `g`
        (N', 3): information and right-hand side of those views (zero for points without a view).
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
        return Prior(ids, charts, q, world_from_ref, info, eta)

    def without(self, gone: NDArray[np.bool_]) -> "Prior":
        """Points (N,) bool marginalised."""
        if not gone.any():
            return self
        drop = np.concatenate([np.repeat(gone, 3), np.zeros(6, bool)])
        info, eta = marginalised(self.information, self.eta, drop)
        return Prior(self.ids[~gone], self.charts[~gone], self.q[~gone], self.world_from_ref, info, eta)

    def with_drift(self, cov_q: Array) -> "Prior":
        """Points that have moved since by independent steps Q of covariance (N, 3, 3): (Λ⁻¹ + Q)⁻¹ on their part.

        With C = Λ_mm + Q⁻¹: Λ'_mm = Q⁻¹ − Q⁻¹C⁻¹Q⁻¹, Λ'_mw = Q⁻¹C⁻¹Λ_mw, Λ'_ww = Λ_ww − Λ_wm C⁻¹ Λ_mw.
        """
        n = len(self.ids)
        m, points = 3 * n, np.arange(n)
        info = self.information
        # steps far below what the prior knows change nothing and would cost digits
        least = (1e-6 / np.diag(info)[:m]).reshape(n, 3, 1) * np.eye(3)
        q_inv = np.linalg.inv(cov_q + least)

        def times_q_inv(matrix: Array) -> Array:
            return (q_inv @ matrix.reshape(n, 3, -1)).reshape(m, -1)

        c = info[:m, :m].copy()
        c.reshape(n, 3, n, 3)[points, :, points, :] += q_inv
        inverse = Cholesky(c).inverse()
        gain = times_q_inv(inverse)  # Q⁻¹C⁻¹
        new = np.empty_like(info)
        mm = -times_q_inv(gain.T)
        mm.reshape(n, 3, n, 3)[points, :, points, :] += q_inv
        new[:m, :m] = symmetric(mm)
        new[:m, m:] = gain @ info[:m, m:]
        new[m:, :m] = new[:m, m:].T
        solved = inverse @ np.concatenate([info[:m, m:], self.eta[:m, None]], axis=1)
        new[m:, m:] = symmetric(info[m:, m:] - info[m:, :m] @ solved[:, :-1])
        eta = np.concatenate([gain @ self.eta[:m], self.eta[m:] - info[m:, :m] @ solved[:, -1]])
        return Prior(self.ids, self.charts, self.q, self.world_from_ref, new, eta)

    def in_camera(self, cam_from_ref: Array) -> "Prior":
        """The prior re-expressed in another camera whose pose is unknown to it: that pose is marginalised.

        The charts go with the points, C' = X C, so q stays what it is; to first order in (δq', ξ, ω')
        δq = δq' − K'G ξ, K' = ∂q'/∂P', and ω = Ad(X⁻¹)(ω' + ξ) as world_from_cam = world_from_ref X⁻¹. The result
        is invariant under ξ: it knows the shape of points and world, not where the new camera stands. Its own views
        must be added next (`with_views`) or it stays singular.
        """
        n = len(self.ids)
        charts = se3.orthonormalised(cam_from_ref @ self.charts)
        k = q_jacobian(homogeneous_from_q(self.q)) @ se3.inverse(charts)
        shift = np.concatenate([-(k @ pose_jacobian(in_reference(charts, self.q))).reshape(3 * n, 6), np.eye(6)])
        ad = se3.adjoint(se3.inverse(cam_from_ref))
        info, eta = self.information.copy(), self.eta.copy()
        info[3 * n :] = ad.T @ info[3 * n :]
        info[:, 3 * n :] = info[:, 3 * n :] @ ad
        eta[3 * n :] = ad.T @ eta[3 * n :]
        cross = info @ shift
        joint = np.block([[info, cross], [cross.T, shift.T @ cross]])
        drop = np.concatenate([np.zeros(3 * n + 6, bool), np.ones(6, bool)])
        info, eta = marginalised(joint, np.concatenate([eta, shift.T @ eta]), drop)
        world_from_cam = se3.orthonormalised(self.world_from_ref @ se3.inverse(cam_from_ref))
        return Prior(self.ids, charts, self.q, world_from_cam, info, eta)
