"""The joint normal equations of the window, factored once per step: [poses 6F | modes k] dense, points eliminated.

Given the poses and the common modes of the prior, points are independent of each other, so each is eliminated by
itself, eqs. (27) and (30) (Schur complement, Triggs et al. 2000, section 6).
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...geometry.linear import Cholesky, matvec, product, scaled_cholesky
from ...geometry.se3 import Array
from .inverse_depth import NormalBlocks
from .prior import Prior


class JointCovariance(NamedTuple):
    """Blocks of the inverse of the normal equations, eq. (28): q of the points, one pose x, the world w.

    `qq` (P, 3, 3), `qx` and `qw` (P, 3, 6), `xx`, `ww` and `xw` (6, 6). `q_by_rig` (P, 3, r) and `x_by_rig` (6, r): the
    part that errors of the rig have in them, by independent amplitudes of variance 1.
    """

    qq: Array
    qx: Array
    qw: Array
    xx: Array
    ww: Array
    xw: Array
    q_by_rig: Array
    x_by_rig: Array


class System:
    """The factored normal equations of `prior` over the points `known` (N,) of the map's P, and of linearised views."""

    def __init__(self, prior: Prior, known: NDArray[np.intp], blocks: NormalBlocks) -> None:
        frames = len(blocks.u)
        self.prior, self.known = prior, known
        self.poses = 6 * frames
        k = prior.modes.shape[2]
        size = self.poses + k
        self.rig = slice(size - len(prior.rig), None)  # its amplitudes come last
        # `pull` (N, 3, k): D⁻¹F; `std_given` (P, 3, 3): of a point once poses and modes are given; `reach` (P, 3, n):
        # of the others, in units of it
        self.d_inv, self.pull, self.std_given, self.reach = core.eliminate_points(
            blocks.v, blocks.w, blocks.rig_point, known, prior.cov, prior.modes
        )
        h = np.zeros((size, size))
        for s in range(frames):
            h[6 * s : 6 * s + 6, 6 * s : 6 * s + 6] = blocks.u[s]
        h[self.poses :, self.poses :] = _flat(prior.modes).T @ _flat(self.pull)
        own = slice(self.poses * (size + 1), self.rig.start * (size + 1), size + 1)  # on the diagonal
        h.flat[own] += 1.0
        h[self.rig, self.rig] += blocks.rig + prior.rig.information
        h[self.rig, : self.poses] = blocks.rig_pose.reshape(self.poses, len(prior.rig)).T  # below the diagonal
        h -= _flat(self.reach).T @ _flat(self.reach)
        self.chol = Cholesky(h)
        self.rig_offset = np.zeros(len(prior.rig))
        self._rig_whitening = self.chol.lower[self.rig, self.rig].T
        # of the covariance of poses and amplitudes; its last columns are of the rig's errors
        self.root = self.chol.root

    def step(self, blocks: NormalBlocks, q: Array, amplitudes: Array) -> tuple[Array, Array, Array, float]:
        """Return steps of poses (F, 6), points (P, 3) and mode amplitudes (k,), and the decrease gᵀδ they promise.

        `blocks` has the right-hand sides of the views alone, at q (P, 3) and `amplitudes` (k,). Errors of the rig move
        to where they are held; `rig_offset` is how far their whitened estimate is from there.
        """
        away = q[self.known] - self.prior.points(amplitudes)
        g_point = blocks.g_point.copy()
        g_point[self.known] -= matvec(self.d_inv, away)
        g = np.concatenate([blocks.g_pose.ravel(), _flat(self.pull).T @ away.ravel() - amplitudes])
        rig, of_rig = self.prior.rig, amplitudes[len(amplitudes) - len(self.prior.rig) :]
        g[self.rig] += of_rig - rig.information @ of_rig + blocks.g_rig + rig.weighted
        given = matvec(np.swapaxes(self.std_given, 1, 2), g_point)
        whitened = self.chol.root.T @ (g - _flat(self.reach).T @ given.ravel())
        to_held = self._rig_whitening @ (rig.held - rig.at(of_rig))
        self.rig_offset = whitened[self.rig] - to_held
        whitened[self.rig] = to_held
        delta = self.chol.root @ whitened
        dq = matvec(self.std_given, given - self.reach @ delta)
        decrease = float(g @ delta + (g_point * dq).sum())
        return delta[: self.poses].reshape(-1, 6), dq, delta[self.poses :], decrease

    def rig_errors(self) -> tuple[Array, Array, Array]:
        """Return mean (m,), covariance and information (m, m) of the rig's errors by all views; held where they are."""
        root, lower = self.chol.root[self.rig, self.rig], self.chol.lower[self.rig, self.rig]
        return self.prior.rig.held + root @ self.rig_offset, root @ root.T, lower @ lower.T

    def follow_rig(self, change: Array) -> tuple[Array, Array, Array]:
        """Return by how much poses (F, 6), points (P, 3) and amplitudes (k,) move where the rig's errors do by (m,)."""
        delta = self.chol.root[:, self.rig] @ (self._rig_whitening @ change)
        dq = -matvec(self.std_given, self.reach @ delta)
        return delta[: self.poses].reshape(-1, 6), dq, delta[self.poses :]

    def count_rig_errors(self, cov: Array) -> None:
        """Let the rig's errors count in all covariances with a covariance (m, m) of their own, eq. (72)."""
        try:
            counted = scaled_cholesky(cov)
        except np.linalg.LinAlgError:
            values, axes = np.linalg.eigh(cov)
            counted = axes * np.sqrt(np.maximum(values, 0.0))
        self.root = np.column_stack([self.chol.root[:, : self.rig.start], self.by_rig_errors @ counted])

    @cached_property
    def by_rig_errors(self) -> Array:
        """∂(poses, amplitudes)/∂c (n, m): how the estimate moves with the rig's errors, K of eq. (72)."""
        return np.asarray(self.chol.root[:, self.rig] @ self._rig_whitening)

    def covariance(self) -> Array:
        """Return the joint covariance of poses and amplitudes about the present estimate, eq. (72)."""
        return np.asarray(self.root @ self.root.T)

    def covariances(self, frame: int) -> JointCovariance:
        """Return the blocks of the inverse for the pose of `frame`; −1 is the reference camera, which has no error."""
        root = self.root
        to_both = np.zeros((len(root), 12))  # to the pose and to the world
        if frame >= 0:
            to_both[6 * frame : 6 * frame + 6, :6] = np.eye(6)
        to_both[self.poses :, 6:] = self.prior.world_modes.T
        both = root.T @ to_both
        through = product(self.reach, root)
        cov_q = (
            self.std_given @ (np.eye(3) + through @ np.swapaxes(through, 1, 2)) @ np.swapaxes(self.std_given, 1, 2)
        )
        with_both = -core.multiply_blocks(self.std_given, product(through, both))
        cov_both = both.T @ both
        return JointCovariance(
            qq=cov_q,
            qx=with_both[..., :6],
            qw=with_both[..., 6:],
            xx=cov_both[:6, :6],
            ww=cov_both[6:, 6:],
            xw=cov_both[:6, 6:],
            q_by_rig=-core.multiply_blocks(self.std_given, through[..., self.rig]),
            x_by_rig=both[self.rig, :6].T,
        )


def _flat(blocks: Array) -> Array:
    """Return (P, 3, n) as (3P, n)."""
    return blocks.reshape(-1, blocks.shape[-1])
