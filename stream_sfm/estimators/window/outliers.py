"""Counts how often each track contradicted the motion, and excludes tracks that did so too often.

Tracks rejected with other errors of the rig are tried again: while a delay or a readout is unknown, good tracks
contradict the motion.
"""

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...config import WindowConfig
from ...geometry import Array
from ...geometry.medians import median
from .inverse_depth import WhitenedViews


class RejectionCounts:
    """The number of rejections of every live track that has any, since the rig's errors were held at `held` (m,)."""

    def __init__(self, held: Array, rules: WindowConfig) -> None:
        self._counts: Counter[int] = Counter()
        self._held, self._rules = held, rules

    def add(self, ids: NDArray[np.int64]) -> None:
        """Count one rejection of each track."""
        self._counts.update(ids.tolist())

    def excluded(self, ids: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which of `ids` (n,) are excluded."""
        often = sorted([i for i, n in self._counts.items() if n >= self._rules.rejections])
        return core.among(ids, np.array(often, np.int64))

    def ask_again(self, newest: WhitenedViews, held: Array) -> None:
        """Forget all counts if the errors `held` (m,) of the rig move the newest views by more than their noise."""
        change = held.copy()
        change[: len(self._held)] -= self._held  # a field may have begun since
        if not (len(newest) and change.any()):
            return
        moved = (newest.root @ newest.shift_px(change)[:, :, None])[:, :, 0]
        if median(np.linalg.norm(moved, axis=1)) > self._rules.moved_sigmas:
            self._counts, self._held = Counter(), held

    def forget_all_but(self, ids: NDArray[np.int64]) -> None:
        """Drop the counts of tracks that have ended; `ids` are alive."""
        for ended in self._counts.keys() - set(ids.tolist()):
            del self._counts[ended]
