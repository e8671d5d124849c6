"""The joint prior of the window: what all frames that left it say about points and world, in the reference camera.

Points that were seen from the same uncertain cameras err together. The prior keeps that in factored form, eq. (29),

    q_i = mean_i + F_i y + e_i,   ω = F_w y,   y ~ N(0, I_k),   e_i ~ N(0, D_i) independent,

with common modes F and their amplitudes y. Once the few amplitudes are given, points are independent of each other: a
window of any number of points is solved with one small dense system, the drift of a patch over its surface just adds
to D_i, and a point that is no longer seen is marginalised by dropping its row. Each frame that is absorbed brings the
six modes of its unknown pose; modes that no longer matter beside the points' own noise are folded into D, where every
point keeps its marginal covariance. (A dense information matrix over 200 points holds the same and costs fifty times as
much.)

Camera-centred: the world's origin is one more pose among the variables, so nothing that touches the prior is ever
relinearised in world coordinates, and unobservable directions stay unobservable (otherwise a bias grows with the number
of frames; docs/mathematics.md, section 6). ω is the right perturbation of world_from_ref.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...geometry import se3
from ...geometry.linear import Cholesky, matvec, scaled_cholesky, symmetric, symmetric_inverse
from ...geometry.se3 import Array
from .inverse_depth import homogeneous_from_q, in_reference, pose_jacobian, q_jacobian

# Added to each variance of a map's first pose, in m² and rad²: the very first camera is the world by definition, and a
# micrometre and a microradian are far below any estimate.
_ORIGIN_VARIANCE = 1e-12
# Variance of a common mode in units of the points' own noise, summed over the points, below which the mode is folded
# away: it then correlates no two points by more than a thousandth. Trades the size of the system for that.
_MIN_MODE_VARIANCE = 1e-3


@dataclass(frozen=True, slots=True)
class Prior:
    """Gaussian knowledge of N points and of the world.

    `ids` (N,) ascending; `ref_from_anchor` (N, 4, 4); `mean` (N, 3) of q; `cov` (N, 3, 3) = D; `modes` (N, 3, k) = F;
    `world_from_ref` (4, 4): mean of the reference camera's pose; `world_modes` (6, k) = F_w.
    """

    ids: NDArray[np.int64]
    ref_from_anchor: Array
    mean: Array
    cov: Array
    modes: Array
    world_from_ref: Array
    world_modes: Array

    @classmethod
    def from_first_frame(
        cls, ids: NDArray[np.int64], mean: Array, cov: Array, world_from_ref: Array, cov_pose: Array
    ) -> "Prior":
        """Begin a map: independent points seen by the reference camera, whose own pose has `cov_pose` (6, 6)."""
        anchors = np.broadcast_to(np.eye(4), (len(ids), 4, 4))
        root = scaled_cholesky(cov_pose + _ORIGIN_VARIANCE * np.eye(6))
        return cls(ids, anchors, mean, cov, np.zeros((len(ids), 3, 6)), world_from_ref, root)

    def points(self, amplitudes: Array) -> Array:
        """Return q (N, 3) at the given amplitudes (k,) of the modes."""
        return self.mean + self.modes @ amplitudes

    def world(self, amplitudes: Array) -> Array:
        """Return world_from_ref (4, 4) at the given amplitudes (k,) of the modes."""
        return se3.orthonormalise(self.world_from_ref @ se3.exp(self.world_modes @ amplitudes))

    def select(self, rows: NDArray[np.bool_]) -> "Prior":
        """Return the prior of the points where the mask is true; the others are marginalised."""
        return replace(
            self,
            ids=self.ids[rows],
            ref_from_anchor=self.ref_from_anchor[rows],
            mean=self.mean[rows],
            cov=self.cov[rows],
            modes=self.modes[rows],
        )

    def with_drift(self, cov: Array) -> "Prior":
        """Return the prior after independent movements of its points, of covariance (N, 3, 3)."""
        return replace(self, cov=self.cov + cov)

    def absorb_frame(self, amplitudes: Array, cam_from_ref: Array, q: Array, v: Array, g: Array) -> "Prior":
        """Return the posterior after one camera's own views, in that camera as the new reference, eqs. (31)–(35).

        `amplitudes` y (k,), `cam_from_ref` X (4, 4) and `q` (N, 3): the present estimate, where all is linearised; `v`
        (N, 3, 3), `g` (N, 3): information and right-hand side of the views (zero for a point without).

        The anchors go with the points, C' = X C, so q stays what it is. The prior knows nothing about the error ξ of
        the new camera's pose: with K' = ∂q'/∂P', δq' = δq + K'G ξ and ω' = Ad(X) ω − ξ, six modes without prior
        information. With Λ = D⁻¹ + V, points given the modes are N(Λ⁻¹(D⁻¹(mean + F y) + V…), Λ⁻¹), and the modes have
        information S = P + Σ Fᵀ(D⁻¹ − D⁻¹Λ⁻¹D⁻¹)F.
        """
        n, k = len(self.ids), len(amplitudes)
        anchors = se3.orthonormalise(cam_from_ref @ self.ref_from_anchor)
        by_pose = q_jacobian(homogeneous_from_q(q)) @ se3.inverse(anchors) @ pose_jacobian(in_reference(anchors, q))
        modes = np.concatenate([self.modes, by_pose], axis=2)
        world_modes = np.concatenate([se3.adjoint(cam_from_ref) @ self.world_modes, -np.eye(6)], axis=1)
        world = self.world(amplitudes) @ se3.inverse(cam_from_ref)
        away = self.points(amplitudes) - q  # the prior's mean at the present modes, from the linearisation point

        d_inv = symmetric_inverse(self.cov)
        cov = symmetric_inverse(d_inv + v)
        shrink = cov @ d_inv
        stay = d_inv - d_inv @ shrink  # D⁻¹ − D⁻¹Λ⁻¹D⁻¹
        update = matvec(cov, matvec(d_inv, away) + g)  # of the points, the modes held
        flat = modes.reshape(3 * n, k + 6)
        s = flat.T @ (stay @ modes).reshape(3 * n, k + 6)
        s[np.arange(k), np.arange(k)] += 1.0
        right = flat.T @ matvec(d_inv, update - away).reshape(3 * n)
        right[:k] -= amplitudes
        chol = Cholesky(symmetric(s))
        step = chol.solve(right)
        modes = shrink @ modes
        return Prior(
            ids=self.ids,
            ref_from_anchor=anchors,
            mean=q + update + modes @ step,
            cov=cov,
            modes=modes @ chol.root,
            world_from_ref=se3.orthonormalise(world @ se3.exp(world_modes @ step)),
            world_modes=world_modes @ chol.root,
        )

    def with_points(self, ids: NDArray[np.int64], ref_from_anchor: Array, mean: Array, cov: Array) -> "Prior":
        """Return the prior with further points that share no mode with the others; ids in any order."""
        all_ids = np.concatenate([self.ids, ids])
        order = np.argsort(all_ids)
        none = np.zeros((len(ids), 3, self.modes.shape[2]))
        return replace(
            self,
            ids=all_ids[order],
            ref_from_anchor=np.concatenate([self.ref_from_anchor, ref_from_anchor])[order],
            mean=np.concatenate([self.mean, mean])[order],
            cov=np.concatenate([self.cov, cov])[order],
            modes=np.concatenate([self.modes, none])[order],
        )

    def truncate_modes(self) -> "Prior":
        """Return the same prior in as few modes as matter, eq. (36).

        Six modes carry the world exactly. The others are principal components of the points' common error in units of
        their own noise; what is left out goes to that noise.
        """
        q, r = np.linalg.qr(self.world_modes.T, mode="complete")
        modes = self.modes @ q
        shared = modes[..., 6:]
        whitened = (np.linalg.inv(np.linalg.cholesky(self.cov)) @ shared).reshape(-1, shared.shape[2])
        variance, axes = np.linalg.eigh(whitened.T @ whitened)
        shared = shared @ axes
        small = variance < _MIN_MODE_VARIANCE
        folded = shared[..., small]
        return replace(
            self,
            cov=self.cov + folded @ np.swapaxes(folded, 1, 2),
            modes=np.concatenate([modes[..., :6], shared[..., ~small]], axis=2),
            world_modes=np.concatenate([r.T[:, :6], np.zeros((6, int((~small).sum())))], axis=1),
        )
