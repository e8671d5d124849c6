"""Which tracks contradicted the motion, and how often: those that did so too often are excluded for good."""

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from ... import core

# Rejections, in any frame, after which a track is never used again. Trades the views of a good track that was unlucky
# (a gate of 99.9 % makes six of them unlikely) against those of one on a slowly moving thing.
_MAX_REJECTIONS = 6


class RejectionCounts:
    """The number of rejections of every live track that has any."""

    def __init__(self) -> None:
        self._counts: Counter[int] = Counter()

    def add(self, ids: NDArray[np.int64]) -> None:
        """Count one rejection of each track."""
        self._counts.update(ids.tolist())

    def excluded(self, ids: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which of `ids` (n,) are excluded."""
        often = sorted([i for i, n in self._counts.items() if n >= _MAX_REJECTIONS])
        return core.among(ids, np.array(often, np.int64))

    def forget_all_but(self, ids: NDArray[np.int64]) -> None:
        """Drop the counts of tracks that have ended; `ids` are alive."""
        for ended in self._counts.keys() - set(ids.tolist()):
            del self._counts[ended]
