"""The window's knowledge of the rig's errors c, as part of the joint prior, eqs. (70) to (72e).

c is estimated by a mixture in which groups of errors may be exactly zero: it is held at the mean of the mixture, and
every covariance contains that of the mixture, so that the attempt to improve an exact calibration does no harm. The
knowledge is kept as information, so other knowledge about c, or a prior of another size, is simply added.
"""

from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from ...config import RigConfig
from ...geometry import Array
from ...geometry.linear import Cholesky, symmetric
from ...record import changed, record
from ...rig_model.estimate import Amplitudes, RigEstimate
from ...rig_model.field import LEAST_PX
from ...rig_model.parts import Agreement, Parts
from ...rig_model.sizes import Mixture, likely_sizes, mixture
from ...rig_model.terms import FOCAL, TERMS

_FOCAL = TERMS.index(FOCAL)
_RULES = RigConfig()


@record
class RigState:
    """c = `mean` (m,) + a, with a of the `information` Λ (m, m) and the `weighted` sum Λ E[a] (m,).

    The points of the prior are given at `mean`; a are the amplitudes of its last modes. `held` (m,): the value at which
    the window holds c, the mean of the mixture, and `cov_held` (m, m): the covariance of the mixture. `size` (m,): σ of
    each error before any view, which is learnt where `sizes_unknown`. `steady`: the errors have not changed; once they
    have, the prior cannot be replaced, and the calibration is wrong. `refined`: the calibration has a refinement,
    so that its lens errors are Gaussian about that, and never exactly zero. `zooms`: a focal length changes by itself;
    `has_refocused`: it has changed and rests, so that it is not the calibrated one. `since_ns`: when errors that grow
    began to. `parts`: information from parts of the run since the last change. `innovation2` (t,): mean squared
    innovation of each term by windows, in its σ, over the last `frames`.
    """

    mean: Array
    information: Array
    weighted: Array
    size: Array
    held: Array
    cov_held: Array
    sizes_unknown: NDArray[np.bool_] | bool = True
    steady: bool = True
    refined: bool = False
    zooms: bool = False
    has_refocused: bool = False
    since_ns: int = 0
    parts: Parts = Parts()
    innovation2: Array = field(default_factory=lambda: np.ones(len(TERMS)))
    frames: int = 0
    rules: RigConfig = _RULES

    @classmethod
    def unknown(
        cls,
        size: Array,
        sizes_unknown: NDArray[np.bool_] | bool = True,
        since_ns: int = 0,
        mean: Array | float = 0.0,
        rules: RigConfig | None = None,
        refined: bool = False,
    ) -> "RigState":
        """Return the prior: m errors of σ `size` (m,) about a mean."""
        m, rules = len(size), rules or _RULES
        size, mean = size.copy(), np.zeros(m) + mean
        size[len(TERMS) :] = LEAST_PX
        cov = np.diag(size**2)
        knowledge = cls(mean, np.diag(size**-2.0), np.zeros(m), size, mean, cov, sizes_unknown, since_ns=since_ns)
        return changed(knowledge, frames=rules.calm_frames, rules=rules, refined=refined)

    def __len__(self) -> int:
        return len(self.mean)

    def age_s(self, stamp_ns: int) -> float:
        """Return the time for which errors may have grown."""
        return (stamp_ns - self.since_ns) / 1e9

    def held_at(self, stamp_ns: int) -> Amplitudes:
        """Return the held errors with their age at a stamp."""
        return Amplitudes(self.held, self.cov_held, self.age_s(stamp_ns))

    def tempered(self, mean: Array, cov: Array, information: Array) -> tuple[Array, Array]:
        """Return the estimate of c from all views, N(`mean`, `cov`), with the window weighted by its share, eq. (72h).

        Temporally correlated view errors are accounted for when frames leave the window, but not inside it, where all
        of them act on the errors that views share. So the window's information is weighted by its share in the result.
        `information` (m, m): the inverse of `cov`.
        """
        by_window, shared = information - self.information, self.information @ cov
        counted = Cholesky(by_window + shared @ self.information).inverse()
        return self.mean + counted @ (by_window @ (mean - self.mean) + shared @ self.weighted), counted

    def contradicted(self, mean: Array, cov: Array) -> "RigState":
        """Return the knowledge after comparing N(`mean`, `cov`) from all views with its own expectation, eq. (72j).

        The innovation of a term by a window is N(0, C₀ − C) if the term is constant and its σ correct. This fails for a
        moving lens, or for errors that no term models: then σ of c is too small by the same factor.
        """
        t = len(TERMS)
        root = Cholesky(self.information).root
        of_terms = root[:t]
        gain = (mean - self.mean)[:t] - of_terms @ (root.T @ self.weighted)
        var = np.maximum((of_terms**2).sum(axis=1) - np.diag(cov)[:t], 1e-9)  # less is rounding
        frames = min(self.frames + 1, self.rules.innovations)
        mean_square = self.innovation2 + (gain**2 / var - self.innovation2) / frames
        return changed(self, innovation2=mean_square, frames=frames)

    @property
    def growth(self) -> Array:
        """The factors (m,) on σ of each error from `innovation2`; at least 1."""
        growth = np.ones(len(self))
        growth[: len(TERMS)] = np.sqrt(np.maximum(self.innovation2, 1.0))
        return growth

    def judged(self, mean: Array, cov: Array, agreement: Agreement | None) -> tuple["RigState", Mixture]:
        """Return the knowledge that holds c at the mixture following from N(`mean`, `cov`) from all views.

        `agreement`: of the parts of the run.
        """
        spread = 1.0 if agreement is None else float(agreement.spread[_FOCAL:].max())
        never_zero = self.refined or not self.steady
        found = mixture(mean, cov, self.size, self.rules, never_zero, spread, self.has_refocused)
        knowledge = changed(self, held=found.mean, cov_held=found.cov)
        return knowledge, Mixture(found.mean, found.cov * np.outer(self.growth, self.growth), found.p_wrong)

    def learnt(self, mean: Array, cov: Array, field_std_px: float, more: Array, weighted: Array) -> "RigState":
        """Return `informed` knowledge with the most likely sizes given N(`mean`, `cov`) from all views, eq. (72a).

        Once the errors have changed, sizes stay.
        """
        if not self.steady:
            return self.informed(more, weighted)
        size = np.where(self.sizes_unknown, likely_sizes(mean, cov, self.size), self.size)
        size[len(TERMS) :] = max(field_std_px, LEAST_PX)
        return changed(self.informed(more + size**-2.0 - self.size**-2.0, weighted), size=size)

    def with_part(self, counts: bool) -> "RigState":
        """Return the knowledge after a frame has left the window; `counts`: whether its information enters `parts`."""
        weighted = self.weighted + self.information @ self.mean
        return changed(self, parts=self.parts.after(self.information, weighted, self.size, counts))

    def informed(self, more: Array, weighted: Array) -> "RigState":
        """Return the knowledge with `more` information (m,) about each error, and its weighted sums (m,).

        The information may be negative, eq. (72b).
        """
        information = self.information + np.diag(more)
        return changed(self, information=information, weighted=self.weighted + weighted - more * self.mean)

    def changed(self, root: Array) -> tuple["RigState", Array, Array]:
        """Return the knowledge after the errors have changed by N(0, `root` rootᵀ), root (m, j), eq. (72e).

        G (m, m) and H (m, j) express the old amplitudes by the new ones a': they are G a' + H y, with y ~ N(0, I)
        independent of the errors. The mean of y is not applied; H is larger by it instead.
        """
        by_change = root.T @ self.information
        cov_change = Cholesky(np.eye(root.shape[1]) + by_change @ root).inverse()  # in units of the root, given c
        kept = np.eye(len(self)) - root @ (cov_change @ by_change)
        held_back = cov_change @ (root.T @ self.weighted)
        apart = root @ np.linalg.cholesky(cov_change + np.outer(held_back, held_back))
        information = symmetric(self.information @ kept)
        knowledge = changed(
            self,
            information=information,
            weighted=kept.T @ self.weighted,
            steady=False,
            parts=Parts(),
        )
        return knowledge, kept, apart

    def refocused(self, share: float = 0.0) -> tuple["RigState", Array, Array]:
        """Return the result of `changed` for a focal length that has changed by about a relative `share`, eq. (72l).

        The other errors are unchanged, and their sizes are still learnt.
        """
        focal, unit = np.eye(len(self))[_FOCAL], self.rules.std_focal
        by, root = share / unit * focal, self.rules.std_refocused / unit * focal[:, None]
        after, kept, apart = self.changed(root)
        after = changed(
            after,
            mean=after.mean + by,
            held=after.held + by,
            cov_held=after.cov_held + root @ root.T,
            size=np.hypot(after.size, root[:, 0]),
            steady=self.steady,
            zooms=True,
            has_refocused=True,
        )
        return after, kept, apart

    def with_field(self, n: int) -> "RigState":
        """Return the knowledge with n more errors, of a field that no view has shown yet."""
        m, none, least = len(self), np.zeros(n), np.full(n, LEAST_PX)
        apart = np.zeros((m, n))
        return changed(
            self,
            mean=np.concatenate([self.mean, none]),
            information=np.block([[self.information, apart], [apart.T, np.diag(least**-2.0)]]),
            weighted=np.concatenate([self.weighted, none]),
            size=np.concatenate([self.size, least]),
            held=np.concatenate([self.held, none]),
            cov_held=np.block([[self.cov_held, apart], [apart.T, np.diag(least**2)]]),
            sizes_unknown=np.concatenate([np.broadcast_to(self.sizes_unknown, m), none == 0]),
        )


NO_RIG = RigState.unknown(np.zeros(0))
"""The knowledge of an exact rig."""


def impossible(rig: RigEstimate | None, rules: RigConfig) -> str:
    """Return the reason why the calibration cannot be right; empty if its errors are plausible or unknown."""
    length = 0.0 if rig is None else float(np.linalg.norm(rig.mean[: len(TERMS)]))
    if length < rules.impossible:
        return ""
    return (
        f"the errors of the calibration would be {length:.1f} times the σ assumed for them: does it belong to these "
        "cameras and this resolution, and has none of them moved?"
    )
