"""Pairs left and right frames by their own stamps: equal stamps first, else the nearest within half a frame.

Works on streams, with bounded memory: each side is put in order (`ordering.py`), then both are merged; no stamp is
ever used twice.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from .ordering import MAX_BYTES, WINDOW, Ordering, Timed

T = TypeVar("T")

_PENDING_FRAMES = 128  # of one side waiting for the other: 4 s at 30 Hz, more than any writer buffers
_UNKNOWN_PERIOD_NS = 10_000_000  # where a side has one frame only: 100 Hz, as fast as stereo cameras usually are


@dataclass(slots=True)
class PairingCounts:
    """What became of the frames; lists are (left, right)."""

    read: list[int] = field(default_factory=lambda: [0, 0])
    paired: int = 0
    paired_exactly: int = 0
    unpaired: list[int] = field(default_factory=lambda: [0, 0])
    unpaired_within: int = 0  # of these, between two pairs, not at the beginning or the end
    disordered: list[int] = field(default_factory=lambda: [0, 0])
    largest_offset_ns: int = 0


class _Side(Generic[T]):
    """The frames of one camera: those being put in order, and those in order that wait for the other camera."""

    def __init__(self, held: int) -> None:
        self.ordering: Ordering[T] = Ordering(held)
        self.queue: deque[Timed[T]] = deque()
        self._queued_bytes = 0

    @property
    def full(self) -> bool:
        """Whether no more frames can wait."""
        size_bytes = self._queued_bytes + self.ordering.size_bytes
        return len(self.queue) >= _PENDING_FRAMES or (len(self.queue) > 1 and size_bytes > MAX_BYTES)

    def add(self, frame: Timed[T]) -> None:
        """Let a frame wait."""
        self.queue.append(frame)
        self._queued_bytes += frame.size_bytes

    def take(self) -> T:
        """The frame that has waited longest."""
        frame = self.queue.popleft()
        self._queued_bytes -= frame.size_bytes
        return frame.item


class Pairer(Generic[T]):
    """Pairs two streams of frames: `push` takes the frames of both sides as they arrive and yields certain pairs.

    Pairs come in ascending order of the left stamp; it is smaller than that of the pair before only where both clocks
    were set back. `held`: as in `Ordering`.
    """

    def __init__(self, held: int = WINDOW) -> None:
        self.counts = PairingCounts()
        self._sides: tuple[_Side[T], _Side[T]] = (_Side(held), _Side(held))
        self._unpaired_since = 0  # the last pair
        self._finished = False

    def push(self, side: int, stamp_ns: int, item: T, size_bytes: int = 0) -> Iterator[tuple[T, T]]:
        """Add a frame of `side` (0 left, 1 right); yield the pairs that are certain now."""
        self.counts.read[side] += 1
        mine, other = self._sides[side], self._sides[1 - side]
        yield from self._enqueue(mine, mine.ordering.push(stamp_ns, item, size_bytes))
        if mine.full:
            # The other side is silent: what it still holds back to be sorted must not be missed.
            while other.ordering.waiting and not other.queue:
                yield from self._enqueue(other, other.ordering.release())
        while mine.full:
            self._drop(side)
        self._count()

    def finish(self) -> Iterator[tuple[T, T]]:
        """Yield the pairs still waiting; the frames left over are unpaired."""
        for side in self._sides:
            for frame in side.ordering.finish():
                side.add(frame)
        self._finished = True
        yield from self._merge()
        for number, side in enumerate(self._sides):
            self.counts.unpaired[number] += len(side.queue)
            side.queue.clear()
        self._count()

    def _count(self) -> None:
        self.counts.disordered = [side.ordering.dropped for side in self._sides]

    def _enqueue(self, side: _Side[T], frames: Iterable[Timed[T]]) -> Iterator[tuple[T, T]]:
        for frame in frames:
            side.add(frame)
            yield from self._merge()

    def _half_period_ns(self) -> float:
        """Half the shorter of the two periods."""
        periods = [period for side in self._sides if (period := side.ordering.period_ns()) is not None]
        return min(periods, default=_UNKNOWN_PERIOD_NS) / 2

    def _merge(self) -> Iterator[tuple[T, T]]:
        lefts, rights = (side.queue for side in self._sides)
        while lefts and rights:
            left, right = lefts[0], rights[0]
            if left.segment != right.segment:
                self._drop(0 if left.segment < right.segment else 1)
                continue
            offset_ns = abs(left.stamp_ns - right.stamp_ns)
            if offset_ns:
                early = 0 if left.stamp_ns < right.stamp_ns else 1
                queue, other = self._sides[early].queue, self._sides[1 - early].queue
                if len(queue) < 2 and not self._finished and not self._sides[1 - early].full:
                    return  # the next frame of the early side may fit better
                following = queue[1] if len(queue) > 1 and queue[1].segment == queue[0].segment else None
                nearer = following is not None and abs(following.stamp_ns - other[0].stamp_ns) < offset_ns
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
            yield self._sides[0].take(), self._sides[1].take()

    def _drop(self, side: int) -> None:
        self._sides[side].take()
        self.counts.unpaired[side] += 1
        self._unpaired_since += 1
