"""Counts how often each track contradicted the motion, and excludes tracks that did so too often."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...config import WindowConfig
from ...record import changed, record


@record
class Rejections:
    """The number of rejections of every live track that has any."""

    rules: WindowConfig
    counts: Mapping[int, int] = field(default_factory=dict)

    def with_more(self, ids: NDArray[np.int64]) -> "Rejections":
        """Count the rejection of each view by the id of its track."""
        counts = Counter(self.counts)
        counts.update(ids.tolist())
        return changed(self, counts=counts)

    def excluded(self, ids: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which of `ids` (n,) are excluded."""
        often = sorted([track for track, n in self.counts.items() if n >= self.rules.rejections])
        return core.among(ids, np.array(often, np.int64))

    def of_live(self, ids: NDArray[np.int64]) -> "Rejections":
        """Drop the counts of tracks that have ended; `ids` are alive."""
        live = set(ids.tolist())
        return changed(self, counts={track: n for track, n in self.counts.items() if track in live})
