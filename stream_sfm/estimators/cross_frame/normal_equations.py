"""The joint normal equations of the window, factored once per step: [poses 6F | modes k] dense, points eliminated.

Given the poses and the common modes of the prior, points are independent of each other, so each is eliminated by
itself, eqs. (27) and (30) (Schur complement, Triggs et al. 2000, section 6).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...geometry.linear import Cholesky, matvec, symmetric, symmetric_inverse
from ...geometry.se3 import Array
from .inverse_depth import NormalBlocks
from .prior import Prior


class JointCovariance(NamedTuple):
    """Blocks of the inverse of the normal equations, eq. (28): q of the points, one pose x, the world w.

    `qq` (P, 3, 3), `qx` and `qw` (P, 3, 6), `xx`, `ww` and `xw` (6, 6).
    """

    qq: Array
    qx: Array
    qw: Array
    xx: Array
    ww: Array
    xw: Array


class System:
    """The factored normal equations of `prior` over the points `known` (N,) of the map's P, and of linearised views."""

    def __init__(self, prior: Prior, known: NDArray[np.intp], blocks: NormalBlocks) -> None:
        frames, points = len(blocks.u), len(blocks.v)
        self.prior, self.known = prior, known
        self.poses = 6 * frames
        k = prior.modes.shape[2]
        size = self.poses + k
        self.rig = slice(size - len(prior.rig), None)  # its amplitudes come last
        self.d_inv = symmetric_inverse(prior.cov)
        v = blocks.v.copy()
        v[known] += self.d_inv
        self.pull = self.d_inv @ prior.modes  # D⁻¹F
        self.cross = np.zeros((points, 3, size))
        self.cross[:, :, : self.poses] = blocks.w
        self.cross[known, :, self.poses :] = -self.pull
        self.cross[:, :, self.rig] += blocks.rig_point @ prior.rig.root
        self.cov_given = symmetric_inverse(v)  # of a point once poses and modes are given
        self.gain = self.cov_given @ self.cross
        h = np.zeros((size, size))
        for s in range(frames):
            h[6 * s : 6 * s + 6, 6 * s : 6 * s + 6] = blocks.u[s]
        h[self.poses :, self.poses :] = np.eye(k) + _flat(prior.modes).T @ _flat(self.pull)
        h[self.rig, self.rig] += prior.rig.root.T @ blocks.rig @ prior.rig.root
        rig_pose = blocks.rig_pose @ prior.rig.root
        h[: self.poses, self.rig] += rig_pose
        h[self.rig, : self.poses] += rig_pose.T
        h -= _flat(self.cross).T @ _flat(self.gain)
        self.chol = Cholesky(symmetric(h))
        self.rig_offset = np.zeros(len(prior.rig))

    def step(self, blocks: NormalBlocks, q: Array, amplitudes: Array) -> tuple[Array, Array, Array, float]:
        """Return steps of poses (F, 6), points (P, 3) and mode amplitudes (k,), and the decrease gᵀδ they promise.

        `blocks` has the right-hand sides of the views alone, at q (P, 3) and `amplitudes` (k,). Errors of the rig that
        are only considered do not move; `rig_offset` is then their whitened estimate.
        """
        away = q[self.known] - self.prior.points(amplitudes)
        g_point = blocks.g_point.copy()
        g_point[self.known] -= matvec(self.d_inv, away)
        g = np.concatenate([blocks.g_pose.ravel(), _flat(self.pull).T @ away.ravel() - amplitudes])
        g[self.rig] += self.prior.rig.root.T @ blocks.g_rig + self.prior.rig.offset
        whitened = self.chol.root.T @ (g - _flat(self.gain).T @ g_point.ravel())
        if not self.prior.rig.estimated:
            self.rig_offset = whitened[self.rig].copy()
            whitened[self.rig] = 0.0
        delta = self.chol.root @ whitened
        dq = matvec(self.cov_given, g_point) - self.gain @ delta
        decrease = float(g @ delta + (g_point * dq).sum())
        return delta[: self.poses].reshape(-1, 6), dq, delta[self.poses :], decrease

    def covariance(self) -> Array:
        """Return the joint covariance of poses and amplitudes about the present estimate, eq. (72).

        Errors of the rig that are held at zero although their estimate is `rig_offset` count as if they were that
        much larger.
        """
        root = self.chol.root
        held = root[:, self.rig] @ self.rig_offset
        return symmetric(root @ root.T) + np.outer(held, held)

    def covariances(self, frame: int) -> JointCovariance:
        """Return the blocks of the inverse for the pose of `frame`; −1 is the reference camera, which has no error."""
        sigma = self.covariance()
        to_world = np.zeros((len(sigma), 6))
        to_world[self.poses :] = self.prior.world_modes.T
        to_pose = np.zeros((len(sigma), 6))
        if frame >= 0:
            to_pose[6 * frame : 6 * frame + 6] = np.eye(6)
        cov_q = self.cov_given + (_flat(self.gain) @ sigma).reshape(self.gain.shape) @ np.swapaxes(self.gain, 1, 2)
        to_both = sigma @ np.concatenate([to_pose, to_world], axis=1)
        with_both = -self.gain @ to_both
        cov_both = np.concatenate([to_pose, to_world], axis=1).T @ to_both
        return JointCovariance(
            cov_q, with_both[..., :6], with_both[..., 6:], cov_both[:6, :6], cov_both[6:, 6:], cov_both[:6, 6:]
        )


def _flat(blocks: Array) -> Array:
    """Return (P, 3, n) as (3P, n)."""
    return blocks.reshape(-1, blocks.shape[-1])
