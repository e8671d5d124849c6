"""The joint normal equations of the window, factored once per step: [poses 6F | own eF | modes k].

The errors that the views of a frame share have e amplitudes per frame (`own`). Given the poses, these amplitudes and
the common modes of the prior, points are independent of each other. So each point is eliminated separately, eqs. (27)
and (30) (Schur complement, Triggs et al. 2000, section 6). `core.window_step` does all of it.
"""

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...geometry import Array
from ...record import changed, record
from .layout import Layout, layout
from .prior import Prior


@record
class System:
    """The factored normal equations of a `prior` and of linearised views of the points of a map.

    `rig`: other normal equations of the same prior and the same frames, of points `rig_ids`, which have the rig's
    errors among their unknowns; the Jacobians by these hardly depend on the weights of the views. `cov_rig` (m, m): the
    covariance of the rig's errors in all covariances, that from all views unless it is replaced.
    """

    prior: Prior
    at: Layout
    solved: core.SolvedWindow
    rig_ids: NDArray[np.int64]
    rig: core.SolvedWindow
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
            return cls(prior, at, solved, beside.rig_ids, beside.rig, beside.cov_rig)
        return cls(prior, at, solved, ids, solved, solved.cov_of_rig)

    @property
    def root(self) -> Array:
        """A root (n, n), upper triangular, of the covariance of poses, own amplitudes and modes given the rig's."""
        return self.solved.root

    @property
    def by_rig(self) -> Array:
        """Their Jacobian (n, m) by the rig's errors, K of eq. (72)."""
        return self.rig.by_rig

    def with_cov_rig(self, cov: Array) -> "System":
        """Return the system with another covariance (m, m) of the rig's errors."""
        return changed(self, cov_rig=cov)
