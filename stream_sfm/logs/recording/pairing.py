"""Pairs left and right frames by their own stamps: equal stamps first, else the nearest within half a frame.

It works on streams, with bounded memory. Each side is sorted first, because recorders swap neighbours and clocks go
wrong. Frames wait in a window, and the earliest one that is later than the last released one is released next.
Frames that cannot be sorted are dropped: stamps that repeat, and single stamps far from their neighbours. If most
of the window is earlier than the released frames, the clock was set back: a new segment begins, in which stamps
ascend again. Then both sides are merged; no stamp is ever used twice.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Generic, TypeVar

import msgspec

T = TypeVar("T")

_PENDING_FRAMES = 128  # frames of one side waiting for the other: 4 s at 30 Hz, more than any writer buffers
_UNKNOWN_PERIOD_NS = 10_000_000  # for a side with one frame only: 100 Hz, as fast as stereo cameras usually are
# Frames held back for sorting: so many that a few wrong stamps are never the majority, but of large frames only as
# many as recorders with several threads swap. A frame that more later arrivals overtake has a wrong stamp. As many
# released stamps are remembered, for the period and for repeats.
_WINDOW, _WINDOW_OF_LARGE = 12, 4
_LARGE_BYTES, _MAX_BYTES = 32 * 2**20, 128 * 2**20  # above, the window is shorter; the most it holds
_FAR_NS = 60_000_000_000  # distance from the other frames at the ends of a recording at which a stamp is wrong
_FEWEST = 3  # least number of frames that show wrong stamps, or a clock set back
# This many consecutive frames of each camera without any partner mean that the clocks differ from then on: no loss
# of images does this.
_PARTED = 12


def _median(numbers: Sequence[int]) -> float:
    """Return the median of integers; that of `statistics` takes 2 ms to import."""
    ordered, middle = sorted(numbers), len(numbers) // 2
    return ordered[middle] if len(ordered) % 2 else (ordered[middle - 1] + ordered[middle]) / 2


def gaps_after(stamps_ns: Sequence[int]) -> list[int]:
    """Return the frames after which another one is missing."""
    periods = [b - a for a, b in pairwise(stamps_ns)]
    longest = 1.6 * _median(periods) if periods else 0  # chosen by hand: a lost frame makes it 2
    return [n for n, period in enumerate(periods) if period > longest > 0]


class PairingCounts(msgspec.Struct):
    """How many frames were paired or lost; lists are (left, right)."""

    read: list[int] = msgspec.field(default_factory=lambda: [0, 0])
    paired: int = 0
    paired_exactly: int = 0
    unpaired: list[int] = msgspec.field(default_factory=lambda: [0, 0])
    unpaired_within: int = 0  # of these, the ones between two pairs, not at the beginning or the end
    disordered: list[int] = msgspec.field(default_factory=lambda: [0, 0])
    parted: int = 0  # frames of each camera without a partner while the two clocks differed
    largest_offset_ns: int = 0


@dataclass(slots=True, eq=False)
class _Frame(Generic[T]):
    """A frame: stamps ascend within a segment, and segments follow each other. `overtaken`: by later arrivals."""

    stamp_ns: int
    size_bytes: int
    item: T
    segment: int = 0
    overtaken: int = 0


class _Side(Generic[T]):
    """The frames of one camera: those being sorted, in order of arrival, and the sorted ones that wait."""

    def __init__(self, held: int) -> None:
        self.window: list[_Frame[T]] = []
        self.queue: deque[_Frame[T]] = deque()
        self.dropped = 0  # frames without a place in the order
        self._held, self.segment = held, 0  # how often the clock was set back
        self._last_ns: int | None = None
        self._recent: deque[int] = deque(maxlen=_WINDOW)

    @property
    def full(self) -> bool:
        """Whether no more frames can wait."""
        size_bytes = sum(frame.size_bytes for frame in (*self.queue, *self.window))
        return len(self.queue) >= _PENDING_FRAMES or (len(self.queue) > 1 and size_bytes > _MAX_BYTES)

    def push(self, frame: _Frame[T]) -> None:
        """Add the next frame, and release those whose turn has come."""
        if frame.stamp_ns in self._recent:
            self.dropped += 1
            return
        self.window.append(frame)
        most = min(self._held, _WINDOW if self._window_bytes() <= _LARGE_BYTES else _WINDOW_OF_LARGE)
        while len(self.window) > most or self._window_bytes() > _MAX_BYTES:
            self.release()

    def release(self) -> None:
        """Release the next of the frames that have arrived, or several if the clock was set back."""
        last_ns = self._before_first() if self._last_ns is None else self._last_ns
        self._last_ns = last_ns
        behind = [n for n, frame in enumerate(self.window) if frame.stamp_ns <= last_ns]
        if len(behind) >= _FEWEST and 2 * len(behind) > len(self.window):
            for frame in sorted(self.window[: behind[0]], key=_stamp):
                self._take(frame)
            self.segment += 1
            self._last_ns = None
            self._recent.clear()
            return
        ahead = [frame for frame in self.window if frame.stamp_ns > last_ns]
        if not ahead:
            self._drop(self.window)
            return
        first = min(ahead, key=_stamp)
        if first.overtaken and first.stamp_ns - last_ns > _FAR_NS:  # no earlier frame has arrived for a while
            self._drop([first])
            return
        for frame in self.window[: self.window.index(first)]:
            frame.overtaken += 1
        self._take(first)
        self._drop([f for f in self.window if f.overtaken > _WINDOW or f.stamp_ns == first.stamp_ns])

    def period_ns(self) -> float | None:
        """Return the median period of the frames released last; None before the second one."""
        periods = [b - a for a, b in pairwise(self._recent)]
        return _median(periods) if periods else None

    def _before_first(self) -> int:
        """Return a time before all stamps of the window, except those that are far too early."""
        stamps = sorted(map(_stamp, self.window))
        if len(stamps) < _FEWEST:
            return stamps[0] - 1
        middle_half_ns = stamps[3 * len(stamps) // 4 - 1] - stamps[len(stamps) // 4]
        return max(stamps[0] - 1, round(_median(stamps)) - max(_FAR_NS, 2 * middle_half_ns))

    def _window_bytes(self) -> int:
        return sum(frame.size_bytes for frame in self.window)

    def _take(self, frame: _Frame[T]) -> None:
        self.window.remove(frame)
        frame.segment, self._last_ns = self.segment, frame.stamp_ns
        self._recent.append(frame.stamp_ns)
        self.queue.append(frame)

    def _drop(self, frames: list[_Frame[T]]) -> None:
        self.dropped += len(frames)
        self.window = [frame for frame in self.window if frame not in frames]


def _stamp(frame: _Frame[T]) -> int:
    return frame.stamp_ns


class Pairer(Generic[T]):
    """Pairs two streams of frames: `push` takes the frames of both sides as they arrive and yields certain pairs.

    Pairs come in ascending order of the left stamp, unless both clocks were set back. `in_order`: so do frames.
    """

    def __init__(self, in_order: bool = False) -> None:
        self.counts = PairingCounts()
        held = 0 if in_order else _WINDOW
        self._sides: tuple[_Side[T], _Side[T]] = (_Side(held), _Side(held))
        self._unpaired_since = [0, 0]  # the last pair
        self._pushed = 0  # the side of the latest frame
        self._finished = False

    def push(self, side: int, stamp_ns: int, item: T, size_bytes: int = 0) -> Iterator[tuple[T, T]]:
        """Add a frame of `side` (0 left, 1 right); return an iterator of the pairs that are certain now."""
        self.counts.read[side] += 1
        self._sides[side].push(_Frame(stamp_ns, size_bytes, item))
        self._pushed = side
        return iter(self._next, None)

    def finish(self) -> Iterator[tuple[T, T]]:
        """Return an iterator of the pairs that still wait; the remaining frames are unpaired."""
        for side in self._sides:
            while side.window:
                side.release()
        self._finished = True
        return iter(self._next, None)

    def _next(self) -> tuple[T, T] | None:
        """Return the next pair, or None if none is certain now; frames that can no longer wait are then dropped."""
        pair = self._match()
        mine, other = self._sides[self._pushed], self._sides[1 - self._pushed]
        while pair is None and mine.full and other.window and not other.queue:
            # The other side is silent, so its frames that are still being sorted must not be missed.
            other.release()
            pair = self._match()
        if pair is not None:
            return pair
        for number, side in enumerate(self._sides):
            while (self._finished and side.queue) or (side is mine and side.full):
                self._drop(number)
        if self._finished:
            self._count_parted(_FEWEST if mine.segment != other.segment else _PARTED)
        return None

    def _match(self) -> tuple[T, T] | None:
        """Return the next pair of the sorted frames, and drop earlier frames without a partner."""
        counts = self.counts
        counts.disordered = [side.dropped for side in self._sides]
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
                    return None  # the next frame of the early side may fit better
                following = queue[1] if len(queue) > 1 and queue[1].segment == queue[0].segment else None
                nearer = following is not None and abs(following.stamp_ns - other[0].stamp_ns) < offset_ns
                periods_ns = [period for side in self._sides if (period := side.period_ns()) is not None]
                if nearer or offset_ns > min(periods_ns, default=_UNKNOWN_PERIOD_NS) / 2:
                    self._drop(early)
                    continue
            else:
                counts.paired_exactly += 1
            if counts.paired:
                counts.unpaired_within += sum(self._unpaired_since)
            self._count_parted(_PARTED)
            self._unpaired_since = [0, 0]
            counts.paired += 1
            counts.largest_offset_ns = max(counts.largest_offset_ns, offset_ns)
            return lefts.popleft().item, rights.popleft().item
        return None

    def _drop(self, side: int) -> None:
        self._sides[side].queue.popleft()
        self.counts.unpaired[side] += 1
        self._unpaired_since[side] += 1

    def _count_parted(self, fewest: int) -> None:
        """Count the frames since the last pair if there are so many on both sides that the clocks must differ."""
        if (frames := min(self._unpaired_since)) >= fewest:
            self.counts.parted += frames
