"""The joint normal equations of the window, factored once per step: [poses 6F | own eF | modes k].

The errors that the views of a frame share have e amplitudes per frame (`own`). Given the poses, these amplitudes and
the common modes of the prior, points are independent of each other. So each point is eliminated separately, eqs. (27)
and (30) (Schur complement, Triggs et al. 2000, section 6). `core.window_step` does all of it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...geometry import Array
from ...geometry.linear import product, times_upper
from ...record import changed, record, rows_of
from .inertia.interval import JOINT
from .layout import Layout, layout
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


@record
class System:
    """The factored normal equations of a `prior` and of linearised views of the points `ids` (P,).

    `rig`: other normal equations of the same prior and the same frames, with their points, which have the rig's errors
    among their unknowns; the Jacobians by these hardly depend on the weights of the views. `cov_rig` (m, m): the
    covariance of the rig's errors in all covariances, that from all views unless it is replaced.
    """

    prior: Prior
    at: Layout
    ids: NDArray[np.int64]
    solved: core.SolvedWindow
    rig: tuple[NDArray[np.int64], core.SolvedWindow]
    cov_rig: Array

    @classmethod
    def of(
        cls, prior: Prior, ids: NDArray[np.int64], solved: core.SolvedWindow, own: int, beside: "System | None" = None
    ) -> "System":
        """Return the system with `own` unknowns of the frames beside their poses.

        `beside`: the one with the rig's errors, if this one has none.
        """
        n, m = len(solved.root), len(prior.rig)
        modes = prior.modes.shape[2] - m
        at = layout(poses=n - own - modes, own=own, modes=modes, rig=m)
        if beside is not None:
            return cls(prior, at, ids, solved, beside.rig, beside.cov_rig)
        return cls(prior, at, ids, solved, (ids, solved), solved.cov_of_rig)

    @property
    def root(self) -> Array:
        """A root (n, n), upper triangular, of the covariance of poses, own amplitudes and modes given the rig's."""
        return self.solved.root

    @property
    def by_rig(self) -> Array:
        """Their Jacobian (n, m) by the rig's errors, K of eq. (72)."""
        return self.rig[1].by_rig

    def with_cov_rig(self, cov: Array) -> "System":
        """Return the system with another covariance (m, m) of the rig's errors."""
        return changed(self, cov_rig=cov)

    def _points_by_rig(self) -> tuple[Array, Array]:
        """Return the Jacobian (P, 3, m) of points by the rig's errors, and the roots (P, 3, 3) that are its units."""
        n, (ids, of_rig) = len(self.root), self.rig
        by_rig = product(of_rig.reach[..., :n], of_rig.by_rig)
        by_rig += of_rig.reach[..., n:]
        if len(ids) == len(self.ids):
            return by_rig, of_rig.std_given
        rows = np.searchsorted(ids, self.ids)
        return rows_of(by_rig, rows), rows_of(of_rig.std_given, rows)

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
        by_own = times_upper(self.solved.reach[..., :n], self.root)
        by_rig, root = self._points_by_rig()
        covariant = product(by_rig, self.cov_rig)
        return (
            CovariancePart(self.solved.std_given, by_own, by_own, product(by_own, own.T), own @ own.T),
            CovariancePart(root, by_rig, covariant, product(covariant, rig.T), rig @ self.cov_rig @ rig.T),
        )
