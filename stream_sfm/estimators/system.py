"""The joint normal equations of the window, factored once a frame.

Points that the prior knows are coupled to each other by it and stay in the dense part; points that only the window
has seen are eliminated one by one (Schur complement, Triggs et al. 2000, section 6).
"""

import numpy as np
from numpy.typing import NDArray

from ..geometry.pose import Array
from .inverse_depth import Linearised
from .linear import Cholesky
from .prior import Prior


class System:
    """The factored normal equations: [poses 6F | prior points 3N | world 6] dense, other points eliminated."""

    def __init__(self, prior: Prior, ids: NDArray[np.int64], lin: Linearised) -> None:
        frames, points = lin.c.shape[:2]
        self.in_prior = np.isin(ids, prior.ids)
        self.frames, self.n_prior = frames, len(prior.ids)
        a, b = 6 * frames, 6 * frames + 3 * self.n_prior
        cross = lin.c.transpose(0, 2, 1, 3)  # (F, 6, P, 3)
        h = np.zeros((b + 6, b + 6))
        for s in range(frames):
            h[6 * s : 6 * s + 6, 6 * s : 6 * s + 6] = lin.u[s]
        h[a:, a:] = prior.information
        blocks = h[a:b, a:b].reshape(self.n_prior, 3, self.n_prior, 3)
        diagonal = np.arange(self.n_prior)
        blocks[diagonal, :, diagonal, :] += lin.v[self.in_prior]
        h[:a, a:b] = cross[:, :, self.in_prior].reshape(a, 3 * self.n_prior)
        h[a:b, :a] = h[:a, a:b].T
        self.new_inverse = np.linalg.inv(lin.v[~self.in_prior])
        self.cross_new = np.swapaxes(
            cross[:, :, ~self.in_prior].reshape(a, points - self.n_prior, 3), 0, 1
        )  # (Pn, 6F, 3)
        self.gain = self.cross_new @ self.new_inverse  # (Pn, 6F, 3)
        flat = (a, 3 * (points - self.n_prior))
        h[:a, :a] -= self.gain.transpose(1, 0, 2).reshape(flat) @ self.cross_new.transpose(1, 0, 2).reshape(flat).T
        self.chol = Cholesky(h)

    def step(self, g_pose: Array, g_point: Array, prior_gradient: Array) -> tuple[Array, Array, Array, float]:
        """Steps of poses (F, 6), points (P, 3), world (6,), and the decrease gᵀδ that they promise."""
        a, n = 6 * self.frames, self.n_prior
        g_new = g_point[~self.in_prior]
        right = np.concatenate([g_pose.ravel(), prior_gradient])
        right[a : a + 3 * n] += g_point[self.in_prior].ravel()
        full = right.copy()
        right[:a] -= (self.gain @ g_new[..., None]).sum(0)[:, 0]
        delta = self.chol.solve(right)
        dx = delta[:a]
        dq = np.empty_like(g_point)
        dq[self.in_prior] = delta[a : a + 3 * n].reshape(n, 3)
        dq[~self.in_prior] = (self.new_inverse @ (g_new - np.einsum("pxk,x->pk", self.cross_new, dx))[..., None])[
            ..., 0
        ]
        decrease = float(full @ delta + (g_new * dq[~self.in_prior]).sum())
        return dx.reshape(-1, 6), dq, delta[a + 3 * n :], decrease
