"""Pairs left and right frames by their own stamps: equal stamps first, else the nearest within half a frame.

Works on streams, with bounded memory. Each side first goes through a small sorting buffer, because recorders write
messages slightly out of order; a frame older than one already released is dropped, and so is a second frame
of one stamp. Then the two ascending sequences are merged; no stamp is ever used twice.
"""

import heapq
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Generic, TypeVar

T = TypeVar("T")

_REORDERED_FRAMES = 4  # of one side held back to be sorted: recorders with several threads swap neighbours
_PENDING_FRAMES = 128  # of one side waiting for the other: 4 s at 30 Hz, more than any writer buffers
_PENDING_BYTES = 128 * 2**20  # of one side; sorting and waiting end earlier where images are large
_PERIODS = 31  # the frame period is the median of this many
_UNKNOWN_PERIOD_NS = 10_000_000  # where a side has one frame only: 100 Hz, as fast as stereo cameras usually are


@dataclass(slots=True)
class PairingCounts:
    """What became of the frames; lists are (left, right)."""

    read: list[int] = field(default_factory=lambda: [0, 0])
    paired: int = 0
    paired_exactly: int = 0
    unpaired: list[int] = field(default_factory=lambda: [0, 0])
    unpaired_within: int = 0  # of these, between two pairs, not at the beginning or the end
    backwards: list[int] = field(default_factory=lambda: [0, 0])
    largest_offset_ns: int = 0


class Pairer(Generic[T]):
    """Pairs two streams of frames: `push` takes the frames of both sides as they arrive and yields certain pairs."""

    def __init__(self) -> None:
        self.counts = PairingCounts()
        self._heaps: tuple[list[tuple[int, int, int, T]], list[tuple[int, int, int, T]]] = ([], [])
        self._last: list[int | None] = [None, None]
        self._queues: tuple[deque[tuple[int, int, T]], deque[tuple[int, int, T]]] = (deque(), deque())
        self._bytes = [0, 0]  # held in heap and queue
        self._recent: tuple[deque[int], deque[int]] = (deque(maxlen=_PERIODS + 1), deque(maxlen=_PERIODS + 1))
        self._serial = 0
        self._unpaired_since = 0  # the last pair
        self._finished = False

    def push(self, side: int, stamp_ns: int, item: T, size_bytes: int = 0) -> Iterator[tuple[T, T]]:
        """Add a frame of `side` (0 left, 1 right); yields pairs in ascending order of the left stamp."""
        self._serial += 1  # equal stamps keep the order of the file, and items need no order
        self.counts.read[side] += 1
        self._bytes[side] += size_bytes
        heapq.heappush(self._heaps[side], (stamp_ns, self._serial, size_bytes, item))
        while self._heaps[side] and (
            len(self._heaps[side]) > _REORDERED_FRAMES or self._bytes[side] > _PENDING_BYTES
        ):
            self._pass_on(side)
            yield from self._merge()
        if self._full(side):
            # The other side is silent: what it still holds back to be sorted must not be missed.
            while self._heaps[1 - side] and not self._queues[1 - side]:
                self._pass_on(1 - side)
                yield from self._merge()
        while self._full(side):
            self._drop(side)

    def finish(self) -> Iterator[tuple[T, T]]:
        """Yield the pairs still waiting; the frames left over are unpaired."""
        for side in (0, 1):
            while self._heaps[side]:
                self._pass_on(side)
        self._finished = True
        yield from self._merge()
        for side in (0, 1):
            self.counts.unpaired[side] += len(self._queues[side])
            self._queues[side].clear()

    def _full(self, side: int) -> bool:
        queue = self._queues[side]
        return len(queue) >= _PENDING_FRAMES or (len(queue) > 1 and self._bytes[side] > _PENDING_BYTES)

    def _pass_on(self, side: int) -> None:
        stamp_ns, _, size_bytes, item = heapq.heappop(self._heaps[side])
        last = self._last[side]
        if last is not None and stamp_ns <= last:
            self.counts.backwards[side] += 1
            self._bytes[side] -= size_bytes
            return
        self._last[side] = stamp_ns
        self._queues[side].append((stamp_ns, size_bytes, item))
        self._recent[side].append(stamp_ns)

    def _half_period_ns(self) -> int:
        """Half the shorter of the two median periods."""
        medians = []
        for recent in self._recent:
            periods = sorted(b - a for a, b in pairwise(recent))
            if periods:
                medians.append(periods[len(periods) // 2])
        return min(medians, default=_UNKNOWN_PERIOD_NS) // 2

    def _merge(self) -> Iterator[tuple[T, T]]:
        lefts, rights = self._queues
        while lefts and rights:
            offset_ns = abs(lefts[0][0] - rights[0][0])
            if offset_ns:
                early = 0 if lefts[0][0] < rights[0][0] else 1
                queue, other = self._queues[early], self._queues[1 - early]
                if len(queue) < 2 and not self._finished and not self._full(1 - early):
                    return  # the next frame of the early side may fit better
                nearer = len(queue) > 1 and abs(queue[1][0] - other[0][0]) < offset_ns
                if nearer or offset_ns > self._half_period_ns():
                    self._drop(early)
                    continue
            else:
                self.counts.paired_exactly += 1
            if self.counts.paired:
                self.counts.unpaired_within += self._unpaired_since
            self._unpaired_since = 0
            self.counts.paired += 1
            self.counts.largest_offset_ns = max(self.counts.largest_offset_ns, offset_ns)
            yield self._take(0), self._take(1)

    def _take(self, side: int) -> T:
        _, size_bytes, item = self._queues[side].popleft()
        self._bytes[side] -= size_bytes
        return item

    def _drop(self, side: int) -> None:
        self._take(side)
        self.counts.unpaired[side] += 1
        self._unpaired_since += 1
