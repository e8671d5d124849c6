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
    """Blocks of the inverse of the normal equations, eq. (28): q of the points, and one pose x with the world w.

    `qq` (P, 3, 3), `q_both` (P, 3, 12) with x and w, `both` (12, 12) of x and w.
    """

    qq: Array
    q_both: Array
    both: Array


class System:
    """The factored normal equations of `prior` over the points `known` (N,) of the map's P, and of linearised views."""

    def __init__(
        self, prior: Prior, known: NDArray[np.intp], blocks: NormalBlocks, q: Array, amplitudes: Array
    ) -> None:
        """Take the points as they are at q (P, 3), where views were linearised, and modes at `amplitudes` (k,)."""
        self.prior, self.poses = prior, 6 * len(blocks.u)
        rig, m = prior.rig, len(prior.rig)
        # `std_given` (P, 3, 3): root of the covariance of a point once poses and modes are given; `reach` (P, 3, n): of
        # the others, in units of it; `_given` (P, 3): its step for itself
        h, modes, self.std_given, self.reach, self._given, self._g = core.window_system(
            blocks, (known, prior.mean, prior.cov, prior.modes, rig.information, rig.weighted), q, amplitudes
        )
        self.rig = slice(len(h) - m, None)  # its amplitudes come last
        self._of_rig = amplitudes[len(amplitudes) - m :]
        h[self.poses :, self.poses :] += _flat(modes).T @ _flat(modes)
        h -= _flat(self.reach).T @ _flat(self.reach)
        self.chol = Cholesky(h)
        self.rig_offset = np.zeros(m)
        self._rig_whitening = self.chol.lower[self.rig, self.rig].T
        # of the covariance of poses and amplitudes; its last columns are of the rig's errors
        self.root = self.chol.root

    def step(self) -> tuple[Array, Array, Array, float]:
        """Return steps of poses (F, 6), points (P, 3) and mode amplitudes (k,), and the decrease gᵀδ they promise.

        Errors of the rig move to where they are held; `rig_offset` is how far their whitened estimate is from there.
        """
        g, given = self._g, self._given
        whitened = self.chol.root.T @ (g - _flat(self.reach).T @ given.ravel())
        to_held = self._rig_whitening @ (self.prior.rig.held - self.prior.rig.at(self._of_rig))
        self.rig_offset = whitened[self.rig] - to_held
        whitened[self.rig] = to_held
        delta = self.chol.root @ whitened
        for_itself = given - self.reach @ delta
        decrease = float(g @ delta + (given * for_itself).sum())
        return delta[: self.poses].reshape(-1, 6), matvec(self.std_given, for_itself), delta[self.poses :], decrease

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
        self.root = self.chol.root.copy()
        self.root[: self.rig.start, self.rig] = self.by_rig_errors[: self.rig.start] @ counted
        self.root[self.rig, self.rig] = counted

    @cached_property
    def by_rig_errors(self) -> Array:
        """∂(poses, amplitudes)/∂c (n, m): how the estimate moves with the rig's errors, K of eq. (72)."""
        others = self.chol.root[: self.rig.start, self.rig] @ self._rig_whitening
        return np.concatenate([others, np.eye(others.shape[1])])

    def covariances(self, frame: int) -> tuple[JointCovariance, JointCovariance]:
        """Return the blocks of the inverse for the pose of `frame`; −1 is the reference camera, which has no error.

        And those given the rig's errors.
        """
        own, of_rig = self.root[: self.rig.start, : self.rig.start], self.root[:, self.rig]  # own is a triangle
        both = np.zeros((len(self.root), 12))  # roots of the covariances of the pose and of the world
        if frame >= 0:
            both[:, :6] = self.root[6 * frame : 6 * frame + 6].T
        both[:, 6:] = self.root[self.poses :].T @ self.prior.world_modes.T
        by_own, by_rig = product(self.reach[..., : self.rig.start], own), product(self.reach, of_rig)
        own_both, rig_both = both[: self.rig.start], both[self.rig]
        qq, q_both, qq_given, q_both_given = core.point_covariances(
            self.std_given, by_own, by_rig, product(by_own, own_both), product(by_rig, rig_both)
        )
        given = JointCovariance(qq_given, q_both_given, own_both.T @ own_both)
        return JointCovariance(qq, q_both, given.both + rig_both.T @ rig_both), given


def _flat(blocks: Array) -> Array:
    """Return (P, 3, n) as (3P, n)."""
    return blocks.reshape(-1, blocks.shape[-1])
