"""The joint prior of the window: what all frames that left it say about points and world, in the reference camera.

Points that were seen from the same uncertain cameras err together. The prior keeps that in factored form, eq. (29),

    q_i = mean_i + F_i y + e_i,   ω = F_w y,   y ~ N(0, I_k),   e_i ~ N(0, D_i) independent,

so that points are independent of each other once the few common modes y are given: a window of any number of points
is solved with one small dense system, the drift of a patch over its surface just adds to D_i, and a point that is
seen no more is marginalised by forgetting its row. Each frame that is absorbed brings the six modes of its unknown
pose; modes that no longer matter beside the points' own noise are folded into D, where every point keeps its
marginal covariance. (A dense information matrix over 200 points holds the same and costs fifty times as much.)

Camera-centred: the world's origin is one more pose among the variables, so nothing that touches the prior is ever
relinearised in world coordinates, and the unobservable directions stay unobservable (DESIGN: bias grows with n
otherwise). ω is the right perturbation of world_from_ref.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...geometry import se3
from ...geometry.linear import Cholesky, symmetric
from ...geometry.se3 import Array
from .inverse_depth import homogeneous_from_q, in_reference, pose_jacobian, q_jacobian

# The very first camera is the world: known to a micrometre and a microradian, far below any estimate.
KNOWN = 1e-12
# Variance of a common mode relative to the points' own noise, all points together, below which it is folded away.
_LEAST_MODE = 1e-3


@dataclass(frozen=True, slots=True)
class Prior:
    """`ids` (N,) ascending; `charts` (N, 4, 4); `mean` (N, 3); `cov` (N, 3, 3) = D; `modes` (N, 3, k) = F;
    `world_from_ref` (4, 4) the world's mean; `world_modes` (6, k) = F_w."""

    ids: NDArray[np.int64]
    charts: Array
    mean: Array
    cov: Array
    modes: Array
    world_from_ref: Array
    world_modes: Array

    @classmethod
    def of_views(
        cls, ids: NDArray[np.int64], mean: Array, cov: Array, world_from_ref: Array, cov_pose: Array
    ) -> "Prior":
        """A map begins: independent points seen by the reference camera, whose own pose has `cov_pose` (6, 6)."""
        scale = np.sqrt(np.diag(cov_pose) + KNOWN)
        root = scale[:, None] * np.linalg.cholesky((cov_pose + KNOWN * np.eye(6)) / np.outer(scale, scale))
        charts = np.broadcast_to(np.eye(4), (len(ids), 4, 4))
        return cls(ids, charts, mean, cov, np.zeros((len(ids), 3, 6)), world_from_ref, root)

    def points(self, y: Array) -> Array:
        """q (N, 3) as the modes (k,) have them."""
        return self.mean + self.modes @ y

    def world(self, y: Array) -> Array:
        """world_from_ref (4, 4) as the modes (k,) have it."""
        return se3.orthonormalise(self.world_from_ref @ se3.exp(self.world_modes @ y))

    def keep(self, rows: NDArray) -> "Prior":
        """The given points (mask); the others are marginalised."""
        return replace(
            self,
            ids=self.ids[rows],
            charts=self.charts[rows],
            mean=self.mean[rows],
            cov=self.cov[rows],
            modes=self.modes[rows],
        )

    def drifted(self, cov: Array) -> "Prior":
        """The points (N) have moved by independent steps of covariance (N, 3, 3)."""
        return replace(self, cov=self.cov + cov)

    def absorbed(self, y: Array, cam_from_ref: Array, q: Array, v: Array, g: Array) -> "Prior":
        """The posterior in a new reference camera after that camera's own views, eqs. (31)–(35).

        `y` (k,), `cam_from_ref` (4, 4) and `q` (N, 3): the present estimate, where all is linearised; `v` (N, 3, 3),
        `g` (N, 3): information and right-hand side of the views (zero for a point without).

        The charts go with the points, C' = X C, so q stays what it is. The prior knows nothing of the new camera's
        pose ξ: with K' = ∂q'/∂P', δq' = δq + K'G ξ and ω' = Ad(X) ω − ξ, six modes without prior information. With
        Λ = D⁻¹ + V, points given modes are N(Λ⁻¹(D⁻¹(mean + F y) + V…), Λ⁻¹), and the modes have information
        S = P + Σ Fᵀ(D⁻¹ − D⁻¹Λ⁻¹D⁻¹)F.
        """
        n, k = len(self.ids), len(y)
        charts = se3.orthonormalise(cam_from_ref @ self.charts)
        by_pose = q_jacobian(homogeneous_from_q(q)) @ se3.inverse(charts) @ pose_jacobian(in_reference(charts, q))
        modes = np.concatenate([self.modes, by_pose], axis=2)
        world_modes = np.concatenate([se3.adjoint(cam_from_ref) @ self.world_modes, -np.eye(6)], axis=1)
        world = self.world(y) @ se3.inverse(cam_from_ref)
        away = self.points(y) - q  # the prior's mean at the present modes, from the linearisation point

        d_inv = symmetric(np.linalg.inv(self.cov))
        cov = symmetric(np.linalg.inv(d_inv + v))
        shrink = cov @ d_inv
        stay = d_inv - d_inv @ shrink  # D⁻¹ − D⁻¹Λ⁻¹D⁻¹
        seen = (cov @ ((d_inv @ away[..., None])[..., 0] + g)[..., None])[..., 0]
        flat = modes.reshape(3 * n, k + 6)
        s = flat.T @ (stay @ modes).reshape(3 * n, k + 6)
        s[np.arange(k), np.arange(k)] += 1.0
        right = flat.T @ (d_inv @ (seen - away)[..., None]).reshape(3 * n)
        right[:k] -= y
        chol = Cholesky(symmetric(s))
        step = chol.solve(right)
        modes = shrink @ modes
        return Prior(
            ids=self.ids,
            charts=charts,
            mean=q + seen + modes @ step,
            cov=cov,
            modes=modes @ chol.root,
            world_from_ref=se3.orthonormalise(world @ se3.exp(world_modes @ step)),
            world_modes=world_modes @ chol.root,
        )

    def joined(self, ids: NDArray[np.int64], charts: Array, mean: Array, cov: Array) -> "Prior":
        """With further points that share no mode with the others; ids in any order."""
        all_ids = np.concatenate([self.ids, ids])
        order = np.argsort(all_ids)
        none = np.zeros((len(ids), 3, self.modes.shape[2]))
        return replace(
            self,
            ids=all_ids[order],
            charts=np.concatenate([self.charts, charts])[order],
            mean=np.concatenate([self.mean, mean])[order],
            cov=np.concatenate([self.cov, cov])[order],
            modes=np.concatenate([self.modes, none])[order],
        )

    def condensed(self) -> "Prior":
        """The same prior in as few modes as matter, eq. (36): six carry the world exactly, the others are principal
        components of the points' common error in units of their own noise, to which goes what is left out."""
        q, r = np.linalg.qr(self.world_modes.T, mode="complete")
        modes = self.modes @ q
        shared = modes[..., 6:]
        whitened = (np.linalg.inv(np.linalg.cholesky(self.cov)) @ shared).reshape(-1, shared.shape[2])
        variance, axes = np.linalg.eigh(whitened.T @ whitened)
        shared = shared @ axes
        small = variance < _LEAST_MODE
        folded = shared[..., small]
        return replace(
            self,
            cov=self.cov + folded @ np.swapaxes(folded, 1, 2),
            modes=np.concatenate([modes[..., :6], shared[..., ~small]], axis=2),
            world_modes=np.concatenate([r.T[:, :6], np.zeros((6, int((~small).sum())))], axis=1),
        )
