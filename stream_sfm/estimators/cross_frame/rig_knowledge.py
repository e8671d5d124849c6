"""What the window knows about the calibration's own error c: considered until it is significant, then estimated.

A view of the camera pair is z = h(P) + B c + noise, with B given (`Observations.rig_effects`). c is part of the joint
prior permanently. While nothing significant is known about it, its mean stays as the calibration says: the error counts
in every covariance but moves no estimate, so that an exact calibration is not harmed by the attempt to improve it. From
the frame on where its estimate differs from zero by far more than its σ, it is estimated with all the rest, eq. (72).
Most tracks must follow, eq. (72c): a body that moves contradicts the calibration, too, but not only that.

How large errors are to be expected is learnt, too, eq. (72a): an exact calibration is believed to be exact within a few
frames, and one with large errors of the disparity may have large errors of the lenses. As c stays in the joint state,
its prior can be exchanged for one of another size at any time, and nothing is lost.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...geometry.linear import Cholesky, symmetric
from ...geometry.se3 import Array
from ...types import RigEstimate

# Of χ², as standard deviations of a Gaussian. Six would take an exact calibration for a wrong one once in a thousand
# million frames; but on exact rigs values have been seen that χ² has at three to four. Real rigs are found at dozens.
_SIGNIFICANT = 8.0
# How far most tracks have to follow the step to significant errors. With wrong calibrations, real and made, up to a
# pixel they go 0.8 to 1.2 of it; where bodies move 0, 0.4 and 0.7 have been seen.
_FOLLOWED = 0.75
# Of χ², as before: from there on it does not matter, as errors of some pixels are too far from linear to be followed.
# They reach it within a frame or two; a slow body was found out by its tracks at twelve.
_BEYOND_DOUBT = 16.0
# Length of all errors together, each in the σ assumed for it beforehand: no calibration errs by more. Real rigs have
# 4 to 16, the most one with a radial error of 12 px in the corner.
_IMPOSSIBLE = 20.0
# Sizes that are considered, all equally probable: from those of rendered images to three times of what is assumed,
# which is their root mean square.
_SIZES = np.geomspace(0.025, 3.0, 41)
# One error may be as large as is assumed although the others are zero, as where the right camera has been turned. This
# part of the variance stays, however small the others are: one error in a hundred is such a one.
_ALONE = 0.1**2


@dataclass(frozen=True, slots=True)
class RigKnowledge:
    """c = `mean` (m,) + `root` (m, m) a, with whitened amplitudes a ~ N(`offset` (m,), I).

    `mean` is taken out of all views. `estimated`: the amplitudes are estimated in the window, and `offset` is 0 after
    each absorbed frame; otherwise they are considered and held at 0. `suspected`: the latest frame found them
    significant. `disputed`: the number of frames in a row, up to the latest, that found them significant although most
    tracks did not follow. `size`: σ of each error before any view. `of_disparity` (m,): which errors change the
    disparity only, and tell the size of all; None where it is known.
    """

    mean: Array
    root: Array
    offset: Array
    size: float = 1.0
    of_disparity: NDArray[np.bool_] | None = None
    estimated: bool = False
    suspected: bool = False
    disputed: int = 0

    @classmethod
    def unknown(cls, m: int, of_disparity: NDArray[np.bool_] | None = None) -> "RigKnowledge":
        """Return the prior: m errors in units of the σ that is assumed for each."""
        return cls(np.zeros(m), np.eye(m), np.zeros(m), of_disparity=of_disparity)

    def __len__(self) -> int:
        return len(self.mean)

    def at(self, amplitudes: Array) -> Array:
        """Return the error c (m,) that the window takes out at the given amplitudes (m,)."""
        return self.mean + self.root @ amplitudes

    def likely_size(self, estimate: RigEstimate) -> float:
        """Return the size of the errors that an estimate from all views makes likely, eq. (72a).

        The root mean square over all sizes, by the probability that each gives to the views where lenses are perfect:
        what patches do wrong that turn and grow looks like errors of the lenses, and must not make room for more of it.
        """
        told = np.asarray(self.of_disparity)
        information = np.linalg.inv(estimate.cov)
        weighted = (information @ estimate.mean)[told]
        of_views = information[np.ix_(told, told)] - np.eye(len(weighted)) / self.size**2
        strength, axes = np.linalg.eigh(of_views)
        ratio = _SIZES[:, None] ** 2 * np.maximum(strength, 0.0)
        gain = _SIZES[:, None] ** 2 * (axes.T @ weighted) ** 2 / (1 + ratio)
        likelihood = 0.5 * (gain - np.log1p(ratio)).sum(axis=1)
        weight = np.exp(likelihood - likelihood.max())
        return float(np.sqrt(weight @ _SIZES**2 / weight.sum() + _ALONE))

    def resized(self, size: float) -> tuple["RigKnowledge", Array]:
        """Return the knowledge with a prior of another size, and U (m, m): amplitudes a are now a', with a = U a'."""
        more = size**-2 - self.size**-2  # information about zero that is added to what the prior had
        u = Cholesky(symmetric(np.eye(len(self)) + more * (self.root.T @ self.root))).root
        offset = u.T @ (self.offset - more * (self.root.T @ self.mean))
        return replace(self, root=self.root @ u, offset=offset, size=size), u

    def changed(self, root: Array) -> tuple["RigKnowledge", Array]:
        """Return the knowledge after the errors have changed by N(0, `root` rootᵀ), root (m, j), eq. (72e).

        And U (m, m + j): the amplitudes of before are a = U (a', y) with a' the new ones and y ~ N(0, I), of which the
        errors do not depend. An estimate of y that is held back makes y that much larger, as in eq. (72). The size of
        the errors is not learnt any further: it was that of the old ones.
        """
        m = len(self)
        q, r = np.linalg.qr(np.concatenate([self.root, root], axis=1).T, mode="complete")
        offset = q[:m].T @ self.offset
        u = q[:m].copy()
        u[:, m:] = u[:, m:] @ np.linalg.cholesky(np.eye(root.shape[1]) + np.outer(offset[m:], offset[m:]))
        return replace(self, root=r[:m].T, offset=offset[:m], of_disparity=None), u

    def significance(self, offset: Array) -> float:
        """Return how far whitened amplitudes (m,) are from zero, as standard deviations of a Gaussian."""
        if not len(self):
            return 0.0
        spread = 2 / (9 * len(self))  # χ² of m degrees of freedom after Wilson and Hilferty (1931)
        return float((np.cbrt(offset @ offset / len(self)) - 1 + spread) / np.sqrt(spread))

    def judge(self, offset: Array, followed: Callable[[], float]) -> "RigKnowledge":
        """Return the knowledge after a frame with the estimate `offset` (m,) of the whitened amplitudes.

        `followed`: how far most tracks go with the step to it. It takes two frames in a row: views that contradict all
        others are found out with the first one.
        """
        if self.estimated:
            return self
        significance = self.significance(offset)
        significant = significance > _SIGNIFICANT
        disputed = _SIGNIFICANT < significance < _BEYOND_DOUBT and followed() < _FOLLOWED
        suspected = significant and not disputed
        return replace(
            self,
            suspected=suspected,
            disputed=self.disputed + 1 if disputed else 0,
            estimated=suspected and self.suspected,
        )

    def after(self, amplitudes: Array, root: Array, step: Array) -> "RigKnowledge":
        """Return the knowledge after a frame was absorbed at the given amplitudes (m,).

        What is left of them has the root (m, m), and the whitened estimate `step` (m,).
        """
        root = self.root @ root
        mean = self.at(amplitudes)
        if self.estimated:
            return replace(self, mean=mean + root @ step, root=root, offset=np.zeros(len(self)))
        return replace(self, mean=mean, root=root, offset=step)


def followed_by_most(track: NDArray[np.intp], residuals: Array, change: Array) -> float:
    """Return how far most tracks go with a step that changes their `residuals`, both (V, 4) whitened, eq. (72c).

    `track` (V,) are indices from 0. The factor that leaves the least absolute residuals along the change, summed over
    tracks, is a weighted median of the tracks' own: as long as most agree, it does not matter what the others do.
    """
    gain = np.bincount(track, (residuals * change).sum(1))
    square = np.bincount(track, (change * change).sum(1))
    moved = square > 0
    if not moved.any():
        return 0.0
    factor, weight = gain[moved] / square[moved], np.sqrt(square[moved])
    order = np.argsort(factor, kind="stable")
    half = np.searchsorted(np.cumsum(weight[order]), weight.sum() / 2)
    return float(factor[order[min(half, len(order) - 1)]])


def impossible(rig: RigEstimate | None) -> str:
    """Say that the errors of the calibration are larger than those of any; empty where they are not, or not known."""
    length = 0.0 if rig is None else float(np.linalg.norm(rig.mean))
    if length < _IMPOSSIBLE:
        return ""
    return (
        f"the errors of the calibration would be {length:.1f} times the σ assumed for them: is it of these cameras "
        "and of this resolution, and has none of them moved?"
    )


def disputed(rig: RigKnowledge) -> str:
    """Say that views disagree about the calibration; empty where they do not, or in one frame alone."""
    if rig.disputed < 2:
        return ""
    return "some views contradict the calibration and others do not: something may be moving"
