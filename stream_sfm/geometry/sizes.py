"""How large the errors of a frame are compared with those assumed: a hidden Markov chain of a few sizes, eq. (7b)."""

from collections.abc import Sequence
from dataclasses import field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..record import changed, record
from .se3 import Array

# Multiples of the assumed σ. With factors of 2 instead of 4 most frames of a motorway drive count as larger than they
# are: it errs by 89 mm instead of 32.
SIZES: Array = 4.0 ** np.arange(4.0)
# Of a size before any frame, and of one that is drawn again: a single frame may be far off.
_DRAWN = np.array([0.9, 0.07, 0.02, 0.01])
REDRAWN = 0.05  # probability per frame: a rig shakes, and a lens focuses, for about a second at a time


@record
class Sizes:
    """The `probabilities` (k,) of `SIZES` in the latest frame. A size stays, or is drawn again."""

    probabilities: Array = field(default_factory=lambda: _DRAWN)

    @cached_property
    def log_prior(self) -> Array:
        """The log probabilities (k,) in the next frame, before it is seen."""
        return np.asarray(np.log((1 - REDRAWN) * self.probabilities + REDRAWN * _DRAWN))

    def after(self, log_likelihoods: Array) -> "Sizes":
        """Return the sizes after a frame with these log likelihoods (k,) of each size."""
        return changed(self, probabilities=_probabilities(self.log_prior + log_likelihoods))

    @property
    def probable(self) -> float:
        """The most probable size."""
        return float(SIZES[self.probabilities.argmax()])


class Weighed(NamedTuple):
    """All combinations of the sizes of k blocks of amplitudes, as a frame shows them.

    `rows` (g, k): the size of each block, as rows of `SIZES`; `log` (g,): log likelihoods, eq. (7b). `information`,
    `weighted` (g,): what the frame then shows of one further amplitude, without its prior.
    """

    rows: NDArray[np.intp]
    log: Array
    information: Array
    weighted: Array

    def sizes(self, before: Sequence[Sizes], log_likelihoods: Array) -> list[Sizes]:
        """Return the sizes of the blocks after a frame with these log likelihoods (g,)."""
        weights = _probabilities(log_likelihoods + self._log_prior(before))
        counts = [np.bincount(rows, weights, len(SIZES)) for rows in self.rows.T]
        return [changed(sizes, probabilities=count) for sizes, count in zip(before, counts, strict=True)]

    def total(self, before: Sequence[Sizes], log_likelihoods: Array) -> float:
        """Return the log likelihood of a frame whatever the sizes, from those of the combinations (g,)."""
        return float(np.logaddexp.reduce(log_likelihoods + self._log_prior(before)))

    def row_of(self, sizes: Sequence[Sizes]) -> int:
        """Return the row of the combination of the most probable size of each block."""
        probable = [s.probabilities.argmax() for s in sizes]
        return int(np.flatnonzero((self.rows == np.array(probable, np.intp)).all(axis=1))[0])

    def _log_prior(self, before: Sequence[Sizes]) -> Array:
        return sum((s.log_prior[rows] for s, rows in zip(before, self.rows.T, strict=True)), np.zeros(len(self.log)))


def _probabilities(log: Array) -> Array:
    weights = np.exp(log - log.max())
    return np.asarray(weights / weights.sum())


def weigh(mean: Array, cov: Array, lengths: Sequence[int]) -> Weighed:
    """Return what amplitudes say about their sizes, and about the last one, eq. (7b).

    `mean` (n,) and `cov` (n, n): estimates, with a prior of σ = 1, of blocks of these `lengths` and one amplitude more.
    """
    rows = np.indices((len(SIZES),) * len(lengths)).reshape(len(lengths), -1).T
    factors = np.repeat(SIZES[rows], lengths, axis=1)  # (g, n − 1)
    shown = np.linalg.inv(cov)
    weighted = shown @ mean
    shown -= np.eye(len(mean))
    k = len(mean) - 1
    right = np.column_stack([weighted[:k], shown[:k, k]])
    log_det, solved = core.solved_by_size(np.ascontiguousarray(shown[:k, :k]), right, factors)
    by_size = right.T @ solved  # (g, 2, 2)
    log = 0.5 * by_size[:, 0, 0] - 0.5 * log_det
    information = np.maximum(shown[k, k] - by_size[:, 1, 1], 1e-9)
    return Weighed(rows, log, information, weighted[k] - by_size[:, 1, 0])
