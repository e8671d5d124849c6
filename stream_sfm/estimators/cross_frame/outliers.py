"""Which tracks contradicted the motion, and how often: those that did so too often are excluded for good."""

import numpy as np
from numpy.typing import NDArray

from ..ids import among

# Rejections, in any frame, after which a track is never used again. Trades the views of a good track that was unlucky
# (a gate of 99.9 % makes six of them unlikely) against those of one on a slowly moving thing.
_MAX_REJECTIONS = 6


class RejectionCounts:
    """The number of rejections of every live track that has any."""

    def __init__(self) -> None:
        self._counts: dict[int, int] = {}

    def add(self, track_id: int) -> None:
        """Count one rejection."""
        self._counts[track_id] = self._counts.get(track_id, 0) + 1

    def excluded(self, ids: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which of `ids` (n,) are excluded."""
        often = sorted(i for i, n in self._counts.items() if n >= _MAX_REJECTIONS)
        return among(ids, np.array(often, np.int64))

    def forget_all_but(self, ids: NDArray[np.int64]) -> None:
        """Drop the counts of tracks that have ended; `ids` are alive."""
        alive = set(ids.tolist())
        self._counts = {i: n for i, n in self._counts.items() if i in alive}
