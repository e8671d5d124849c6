"""The joint normal equations of the window, factored once per step: [poses 6F | own eF | modes k].

What the views of a frame err by in common has e amplitudes in each frame. Given poses, these and the common modes of
the prior, points are independent of each other, so each is eliminated by itself, eqs. (27) and (30) (Schur
complement, Triggs et al. 2000, section 6).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...geometry import Array
from ...geometry.linear import Cholesky, Elimination, matvec, product, times_upper
from ...record import rows_of
from .interval import JOINT
from .layout import layout
from .prior import Prior


class CovariancePart(NamedTuple):
    """One of two parts of the joint covariance of points, a pose x and the world w, eq. (28).

    With what reaches points, in units `root` (P, 3, 3) of their own covariance given the others: `reach` (P, 3, k), of
    k variables; `covariant` (P, 3, k): times the covariance of these; `with_both` (P, 3, 12): times theirs with x and
    w. And `both` (12, 12): of x and w.
    """

    root: Array
    reach: Array
    covariant: Array
    with_both: Array
    both: Array


class System:
    """The factored normal equations of `prior` over the points `known` (N,) of the map's P, and of linearised views.

    The rig's errors c (m,) come last: given these, `root` (n, n) is a root of the covariance of poses and modes, upper
    triangular, and `by_rig` (n, m) is how they move with c, K of eq. (72). `cov_rig` (m, m): what c counts with in all
    covariances, that by all views unless it is exchanged.
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
        """Take the points as they are at q (P, 3), where views were linearised, and modes at `amplitudes` (k,).

        `inertial`: information about poses and inertial state (6F + 17, …), and the right-hand side. `beside`: another
        system of the same prior, which may have errors of the rig where this one has none.
        """
        frames, of_frame = blocks.u.shape[:2]
        m = len(prior.rig)
        self.prior, self._own = prior, (frames, of_frame - 6)
        modes = prior.modes.shape[2] - m
        self.at = layout(poses=6 * frames, own=frames * (of_frame - 6), modes=modes, rig=m)
        # `std_given` (P, 3, 3): root of the covariance of a point once poses and modes are given; `_reach` (P, 3, n +
        # m): of the others, in units of it; `_given` (P, 3): its step for itself
        h, half, self.std_given, self._reach, self._given, self._g = core.window_system(
            blocks, prior, known, q, amplitudes
        )
        self._rig_error = prior.rig_at(amplitudes)
        of_modes = self.at.span("modes", "rig")
        # what the prior says of its modes by the points
        self._of_modes: Array = _flat(half).T @ _flat(half) if beside is None else beside._of_modes[:modes, :modes]
        h[of_modes, of_modes] += self._of_modes
        with np.errstate(over="ignore", invalid="ignore"):  # of an iteration that diverges, which its factor shows
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
        # what moves the points with the rig's errors, and in which rows they are there
        self._of_rig: tuple[System, NDArray[np.intp]] | None = None

    def step(self) -> tuple[Array, Array, Array, Array, float]:
        """Return steps of poses (F, 6), their own (F, e), points (P, 3), modes (k,), and the decrease gᵀδ they promise.

        Errors of the rig move to where they are held.
        """
        g, given, to_held = self._g, self._given, self.prior.rig.held - self._rig_error
        others, self._pull = self._others.reduced(g - _flat(self._reach).T @ given.ravel())
        delta = np.concatenate([others + self.by_rig @ to_held, to_held])
        for_itself = given - self._reach @ delta
        decrease = float(g @ delta + (given * for_itself).sum())
        return *self._steps(delta, for_itself), decrease

    def _steps(self, delta: Array, for_itself: Array) -> tuple[Array, Array, Array, Array]:
        """Return steps of poses (F, 6), their own (F, e), points (P, 3) and modes (k,)."""
        poses, own, modes = delta[self.at["poses"]], delta[self.at["own"]], delta[self.at["own"].stop :]
        return poses.reshape(-1, 6), own.reshape(self._own), matvec(self.std_given, for_itself), modes

    def with_rig_of(self, other: "System", rows: NDArray[np.intp]) -> None:
        """Take from another system how poses, modes and points move with the rig's errors, where this one has none.

        `rows` (P,): the points in the other system. How they move hardly depends on the weights of the views.
        """
        self.prior, self.by_rig, self.cov_rig, self._of_rig = (
            other.prior,
            other.by_rig,
            other.cov_rig,
            (other, rows),
        )

    def _points_by_rig(self) -> tuple[Array, Array]:
        """Return how points move with the rig's errors, (P, 3, m), and the roots (P, 3, 3) in whose units they do."""
        if self._of_rig is not None:
            other, rows = self._of_rig
            by_rig, root = other._points_by_rig()
            return (by_rig, root) if len(rows) == len(root) else (rows_of(by_rig, rows), rows_of(root, rows))
        n = len(self.root)
        by_rig = product(self._reach[..., :n], self.by_rig)
        by_rig += self._reach[..., n:]
        return by_rig, self.std_given

    @property
    def by_points(self) -> tuple[Array, Array]:
        """How the others reach points (P, 3, n + m), poses first, and the steps of points for themselves (P, 3), in
        units of their roots."""
        return self._reach, self._given

    def rig_errors(self) -> tuple[Array, Array, Array]:
        """Return mean (m,), covariance and information (m, m) of the rig's errors by all views."""
        return self._rig_error + self.cov_rig @ self._pull, self.cov_rig, self._others.left

    def follow_rig(self, change: Array) -> tuple[Array, Array, Array, Array]:
        """Return the steps of all where the rig's errors move by (m,)."""
        delta = np.concatenate([self.by_rig @ change, change])
        return self._steps(delta, -(self._reach @ delta))

    def pose_and_world(self, frame: int) -> tuple[Array, Array]:
        """Return a root (12, n) of the covariance of the pose of `frame` and of the world given the rig's errors.

        And how both move with these, (12, m). Frame −1 is the reference camera, which has no error.
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
        """Return the covariances given the rig's errors, with the pose of `frame`, and what these errors add."""
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
