"""Counts how often each track contradicted the motion, and excludes tracks that did so too often.

Tracks rejected with other errors of the rig are tried again: while a delay or a readout is unknown, good tracks
contradict the motion.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...config import WindowConfig
from ...geometry import Array
from ...geometry.medians import median
from ...record import changed, record
from .inverse_depth import WhitenedViews


@record
class Rejections:
    """The number of rejections of every live track that has any, since the rig's errors were held at `held` (m,)."""

    rules: WindowConfig
    held: Array
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

    def asked_again(self, newest: WhitenedViews, held: Array) -> "Rejections":
        """Forget all counts if the errors `held` (m,) of the rig move the newest views by more than their noise."""
        change = held.copy()
        change[: len(self.held)] -= self.held  # a field may have begun since
        if not (len(newest) and change.any()):
            return self
        moved = (newest.root @ newest.shift_px(change)[:, :, None])[:, :, 0]
        if median(np.linalg.norm(moved, axis=1)) <= self.rules.moved_sigmas:
            return self
        return Rejections(self.rules, held)

    def of_live(self, ids: NDArray[np.int64]) -> "Rejections":
        """Drop the counts of tracks that have ended; `ids` are alive."""
        live = set(ids.tolist())
        return changed(self, counts={track: n for track, n in self.counts.items() if track in live})
