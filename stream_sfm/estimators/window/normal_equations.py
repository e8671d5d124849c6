"""The joint normal equations of the window, factored once per step: [poses 6F | own eF | modes k].

The errors that the views of a frame share have e amplitudes per frame (`own`). Given the poses, these amplitudes and
the common modes of the prior, points are independent of each other. So each point is eliminated separately, eqs. (27)
and (30) (Schur complement, Triggs et al. 2000, section 6). The core sums over views and points; products of large
matrices are NumPy's, whose BLAS takes 0.36 ms for 468 × 171 where portable C++ takes 0.97.
"""

from copy import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...geometry import Array
from ...geometry.linear import Cholesky, Elimination, matvec, product, times_upper
from ...record import rows_of
from .inertia.interval import JOINT
from .layout import layout
from .prior import Prior


class CovariancePart(NamedTuple):
    """One of two parts of the joint covariance of points, a pose x and the world w, eq. (28).

    `root` (P, 3, 3): root of the covariance of each point given all other variables; the rest is in units of it.
    `reach` (P, 3, k): Jacobian of points by k variables; `covariant` (P, 3, k): times the covariance of these;
    `with_both` (P, 3, 12): times their covariance with x and w. `both` (12, 12): the covariance of x and w.
    """

    root: Array
    reach: Array
    covariant: Array
    with_both: Array
    both: Array


class System:
    """The factored normal equations of `prior` over the points `known` (N,) of the map's P, and of linearised views.

    The rig's errors c (m,) come last. `root` (n, n), upper triangular, is a root of the covariance of poses and modes
    given c, and `by_rig` (n, m) their Jacobian by c, K of eq. (72). `cov_rig` (m, m): the covariance of c in all
    covariances, that from all views unless it is replaced.
    """

    def __init__(
        self,
        prior: Prior,
        known: NDArray[np.intp],
        blocks: core.NormalBlocks,
        q: Array,
        amplitudes: Array,
        inertial: tuple[Array, Array] | None = None,
        beside: "System | None" = None,
    ) -> None:
        """Factor the normal equations at points q (P, 3), where views were linearised, and modes `amplitudes` (k,).

        `inertial`: information about poses and inertial state (6F + 17, …), and the right-hand side. `beside`: another
        system of the same prior, which may have errors of the rig when this one has none.
        """
        frames, of_frame = blocks.u.shape[:2]
        m = len(prior.rig)
        self.prior, self._own = prior, (frames, of_frame - 6)
        modes = prior.modes.shape[2] - m
        self.at = layout(poses=6 * frames, own=frames * (of_frame - 6), modes=modes, rig=m)
        # `std_given` (P, 3, 3): root of the covariance of a point given poses and modes; in units of it, `_reach` (P,
        # 3, n + m): coupling to the other variables; `_given` (P, 3): the step of the point alone
        h, half, self.std_given, self._reach, self._given, self._g = core.window_system(
            blocks, prior, known, q, amplitudes
        )
        self._rig_error = prior.rig_at(amplitudes)
        of_modes = self.at.span("modes", "rig")
        # information of the prior about its modes by the points
        self._of_modes: Array = _flat(half).T @ _flat(half) if beside is None else beside._of_modes[:modes, :modes]
        h[of_modes, of_modes] += self._of_modes
        with np.errstate(over="ignore", invalid="ignore"):  # if the iteration diverges, which the factor shows
            h -= _flat(self._reach).T @ _flat(self._reach)
        if inertial is not None:
            (about, right), of_poses = inertial, self.at["poses"]
            state = prior.world_modes[JOINT["state"]]
            moving = np.flatnonzero(state.any(axis=0))  # most modes do not touch the state
            by_moving, of_moving = state[:, moving].T, of_modes.start + moving
            by_both = by_moving @ about[of_poses.stop :]
            h[of_poses, of_poses] += about[of_poses, of_poses]
            h[of_moving, of_poses] += by_both[:, of_poses]  # only the lower triangle is read
            h[of_moving[:, None], of_moving] += by_both[:, of_poses.stop :] @ by_moving.T
            self._g = self._g.copy()
            self._g[of_poses] += right[of_poses]
            self._g[of_moving] += by_moving @ right[of_poses.stop :]
        self._others = Elimination(h, self.at["rig"].start)
        self.root, self.by_rig = self._others.root, self._others.by_others
        self.cov_rig = Cholesky(self._others.left).inverse() if m else self._others.left
        # another system with the rig's errors, and the rows of the points in it
        self._of_rig: tuple[System, NDArray[np.intp]] | None = None

    def step(self) -> tuple[Array, Array, Array, Array, float]:
        """Return steps of poses (F, 6), `own` (F, e), points (P, 3) and modes (k,), and the predicted decrease gᵀδ.

        Errors of the rig move to where they are held.
        """
        g, given, to_held = self._g, self._given, self.prior.rig.held - self._rig_error
        others, self._pull = self._others.reduced(g - _flat(self._reach).T @ given.ravel())
        delta = np.concatenate([others + self.by_rig @ to_held, to_held])
        for_itself = given - self._reach @ delta
        decrease = float(g @ delta + (given * for_itself).sum())
        return *self._steps(delta, for_itself), decrease

    def _steps(self, delta: Array, for_itself: Array) -> tuple[Array, Array, Array, Array]:
        """Return steps of poses (F, 6), `own` (F, e), points (P, 3) and modes (k,)."""
        poses, own, modes = delta[self.at["poses"]], delta[self.at["own"]], delta[self.at["own"].stop :]
        return poses.reshape(-1, 6), own.reshape(self._own), matvec(self.std_given, for_itself), modes

    def with_rig_of(self, other: "System", rows: NDArray[np.intp]) -> "System":
        """Return the system with the Jacobians by the rig's errors from another system, as this one has none.

        `rows` (P,): the points in the other system. The Jacobians hardly depend on the weights of the views.
        """
        result = copy(self)
        result.prior, result.by_rig, result.cov_rig = other.prior, other.by_rig, other.cov_rig
        result._of_rig = other, rows
        return result

    def with_cov_rig(self, cov: Array) -> "System":
        """Return the system with another covariance (m, m) of the rig's errors."""
        result = copy(self)
        result.cov_rig = cov
        return result

    def _points_by_rig(self) -> tuple[Array, Array]:
        """Return the Jacobian (P, 3, m) of points by the rig's errors, and the roots (P, 3, 3) that are its units."""
        if self._of_rig is not None:
            other, rows = self._of_rig
            by_rig, root = other._points_by_rig()
            return (by_rig, root) if len(rows) == len(root) else (rows_of(by_rig, rows), rows_of(root, rows))
        n = len(self.root)
        by_rig = product(self._reach[..., :n], self.by_rig)
        by_rig += self._reach[..., n:]
        return by_rig, self.std_given

    def rig_errors(self) -> tuple[Array, Array, Array]:
        """Return mean (m,), covariance and information (m, m) of the rig's errors from all views."""
        return self._rig_error + self.cov_rig @ self._pull, self.cov_rig, self._others.left

    def follow_rig(self, change: Array) -> tuple[Array, Array, Array, Array]:
        """Return the steps of all variables if the rig's errors move by (m,)."""
        delta = np.concatenate([self.by_rig @ change, change])
        return self._steps(delta, -(self._reach @ delta))

    def pose_and_world(self, frame: int) -> tuple[Array, Array]:
        """Return a root (12, n) of the covariance of the pose of `frame` and of the world given the rig's errors.

        The second result (12, m) is the Jacobian of both by these errors. Frame −1 is the reference camera, which has
        no error.
        """
        of, modes, world = self.prior.of_modes, self.at["modes"], self.prior.world_modes[JOINT["pose"]]
        of_own, of_rig = world[:, of["own"]], world[:, of["rig"]]
        own, rig = np.zeros((12, len(self.root))), np.zeros((12, len(self.cov_rig)))
        if frame >= 0:
            rows = slice(6 * frame, 6 * frame + 6)
            own[:6], rig[:6] = self.root[rows], self.by_rig[rows]
        own[6:], rig[6:] = of_own @ self.root[modes], of_own @ self.by_rig[modes] + of_rig
        return own, rig

    def covariances(self, frame: int) -> tuple[CovariancePart, CovariancePart]:
        """Return covariances with the pose of `frame`: those given the rig's errors, and the part these errors add."""
        n, (own, rig) = len(self.root), self.pose_and_world(frame)
        by_own = times_upper(self._reach[..., :n], self.root)
        by_rig, root = self._points_by_rig()
        covariant = product(by_rig, self.cov_rig)
        return (
            CovariancePart(self.std_given, by_own, by_own, product(by_own, own.T), own @ own.T),
            CovariancePart(root, by_rig, covariant, product(covariant, rig.T), rig @ self.cov_rig @ rig.T),
        )


def _flat(blocks: Array) -> Array:
    """Return (P, 3, n) as (3P, n)."""
    return blocks.reshape(-1, blocks.shape[-1])
