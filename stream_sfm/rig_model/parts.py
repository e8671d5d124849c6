"""Whether parts of a run agree about the rig errors: evidence that does not depend on the σ of views, eq. (72k).

A real error is the same in each third of a run. A spurious one, which explains slow drift, is not: thirds of a drive
with a rigid, triggered rig gave 0.8, 1.0 and 0.3 ms, and the whole run gave 1.5 ± 0.1. Frames whose motion may not be
the camera's are in no part: rig errors would explain a body that is tracked, and all parts would agree about them.
"""

from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..geometry import Array
from ..record import changed, record
from .terms import AT_TURNING, TERMS


@record
class _End:
    """The information of the first frames of a run about the terms: `information` (t, t) and weighted sums (t,)."""

    frames: int
    information: Array
    weighted: Array


class Agreement(NamedTuple):
    """For each term (t,): the mean of the thirds of a run, its σ, and `spread`: their difference in σ, at least 1.

    `thirds` (3, 2, t): what each third says without the prior, and its σ.
    """

    mean: Array
    std: Array
    spread: Array
    thirds: Array

    @property
    def evidence(self) -> Array:
        """The number of σ (t,) on which thirds of the run agree for each term; its three for a turn."""
        squared = (self.mean / self.std) ** 2
        squared[AT_TURNING] = squared[AT_TURNING].sum()
        return np.asarray(np.sqrt(squared))


@record
class Parts:
    """The ends of parts of a run, one per `every` frames, and that of the latest frame. Parts grow with the run.

    `whole`: that of all frames so far, whether in the parts or not.
    """

    ends: tuple[_End, ...] = ()
    latest: _End | None = None
    whole: _End | None = None
    every: int = 1

    def after(self, information: Array, weighted: Array, size: Array, counts: bool = True) -> "Parts":
        """Return the parts after a frame has left the window, from the prior's information about the rig errors (m,).

        `information` (m, m) and weighted sums (m,) of the errors themselves, whose prior σ is `size` (m,);
        `counts`: the motion of the frame is that of the camera.
        """
        t = len(TERMS)
        of_views = information[:t, :t] - np.diag(size[:t] ** -2.0)
        none = _End(0, np.zeros_like(of_views), np.zeros(len(of_views)))
        before, parts = self.whole or none, self.latest or none
        whole = _End(before.frames + 1, of_views, weighted[:t].copy())
        if not counts:
            return changed(self, whole=whole)
        by_frame = of_views - before.information, whole.weighted - before.weighted
        latest = _End(parts.frames + 1, parts.information + by_frame[0], parts.weighted + by_frame[1])
        ends, every = self.ends, self.every
        if latest.frames % every == 0:
            ends = (*ends, latest)
        if len(ends) > 12:  # half of them are enough for choosing thirds
            ends, every = ends[1::2], 2 * every
        return changed(self, ends=ends, latest=latest, whole=whole, every=every)

    @property
    def agreement(self) -> Agreement | None:
        """Return the estimates of each term by thirds of the run, in amplitudes of prior σ = 1; None if short."""
        if self.latest is None or self.latest.frames < 3 * 8:  # eight frames make a part
            return None
        n = self.latest.frames
        inner = [min(self.ends, key=lambda end: abs(end.frames - k * n / 3)) for k in (1, 2)]
        found = [_of_third(first, last) for first, last in pairwise((None, *inner, self.latest))]
        means, variances = (np.stack(each) for each in zip(*found, strict=True))
        weights = np.maximum(1 / variances - 1, 1e-9)  # without the prior
        means, variances = means / (variances * weights), 1 / weights
        var = 1 / weights.sum(axis=0)
        mean = var * (weights * means).sum(axis=0)
        chi2 = (weights * (means - mean) ** 2).sum(axis=0)
        spread = np.sqrt(np.maximum(chi2 / 2, 1.0))
        return Agreement(mean, spread * np.sqrt(var), spread, np.stack([means, np.sqrt(variances)], axis=1))


@lru_cache(maxsize=8)  # the ends of the first two thirds stay the same for many frames
def _of_third(first: _End | None, last: _End) -> tuple[Array, Array]:
    """Return means and variances (t,) of the terms, in amplitudes of prior σ = 1, by the frames between two ends."""
    information, weighted = last.information, last.weighted
    if first is not None:
        information, weighted = information - first.information, weighted - first.weighted
    values, axes = np.linalg.eigh(information)
    # a part that reduces the information along an axis says nothing there, neither how much nor what
    share, says = 1 / (1 + np.maximum(values, 0.0)), values > 0
    return (axes * (share * says)) @ (axes.T @ weighted), axes**2 @ share
