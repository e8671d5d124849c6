"""Puts the frames of one camera in the order of their stamps: recorders swap neighbours, and clocks go wrong.

Frames wait in a window, and the earliest one that is later than the last one released is released next. What cannot
be put in order is dropped: stamps that repeat, and single stamps far from those around them. Where most of the window
is earlier than what was released, the clock was set back: a new segment begins, in which stamps ascend again.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from typing import Generic, TypeVar

T = TypeVar("T")

# Frames held back to be sorted, so many that a few wrong stamps are never most of them; of large frames as many as
# recorders with several threads swap.
WINDOW, _WINDOW_OF_LARGE = 12, 4
_LARGE_BYTES, MAX_BYTES = 32 * 2**20, 128 * 2**20  # in the window: more are large, and are never held
_MAX_OVERTAKEN = 8  # a frame that more later arrivals than this have overtaken has a wrong stamp
_FAR_NS = 60_000_000_000  # from the other frames, at the ends of a recording: the stamp is wrong
_FEWEST = 3  # frames that show which stamps are wrong, or a clock set back
_RECENT = 32  # released stamps remembered, for the period and for repeats


@dataclass(slots=True)
class Timed(Generic[T]):
    """A frame: stamps ascend within a segment, and segments follow each other. `overtaken`: by later arrivals."""

    stamp_ns: int
    arrival: int
    size_bytes: int
    item: T
    segment: int = 0
    overtaken: int = 0


class Ordering(Generic[T]):
    """The frames of one camera in order; `dropped` counts those that have none, `size_bytes` is of those waiting.

    `held`: how many frames wait to be sorted, 0 where they come in order.
    """

    def __init__(self, held: int = WINDOW) -> None:
        self._held = held
        self.dropped = self.size_bytes = 0
        self._arrivals = self._segment = 0
        self._window: list[Timed[T]] = []
        self._last_ns: int | None = None
        self._recent: deque[int] = deque(maxlen=_RECENT)

    def push(self, stamp_ns: int, item: T, size_bytes: int) -> Iterator[Timed[T]]:
        """Add the frame that arrives next; yield those whose turn has come."""
        if stamp_ns in self._recent:
            self.dropped += 1
            return
        self._arrivals += 1
        self._window.append(Timed(stamp_ns, self._arrivals, size_bytes, item))
        self.size_bytes += size_bytes
        most = min(self._held, WINDOW if self.size_bytes <= _LARGE_BYTES else _WINDOW_OF_LARGE)
        while len(self._window) > most or self.size_bytes > MAX_BYTES:
            yield from self.release()

    @property
    def waiting(self) -> int:
        """How many frames wait."""
        return len(self._window)

    def release(self) -> Iterator[Timed[T]]:
        """Yield the frame that is next by what has arrived, or several where the clock was set back."""
        if self._last_ns is None:
            self._last_ns = self._before_first()
        last_ns = self._last_ns
        behind = [n for n, frame in enumerate(self._window) if frame.stamp_ns <= last_ns]
        if len(behind) >= _FEWEST and 2 * len(behind) > len(self._window):
            yield from [self._take(frame) for frame in sorted(self._window[: behind[0]], key=_order)]
            self._segment += 1
            self._last_ns = None
            self._recent.clear()
            return
        ahead = [frame for frame in self._window if frame.stamp_ns > last_ns]
        if not ahead:
            self._drop(self._window)
            return
        first = min(ahead, key=_order)
        if first.overtaken and first.stamp_ns - last_ns > _FAR_NS:  # nothing before it has arrived for a while
            self._drop([first])
            return
        yield self._take(first)
        for frame in self._window:
            frame.overtaken += frame.arrival < first.arrival
        self._drop([f for f in self._window if f.overtaken > _MAX_OVERTAKEN or f.stamp_ns == first.stamp_ns])

    def finish(self) -> Iterator[Timed[T]]:
        """Yield the frames still waiting."""
        while self._window:
            yield from self.release()

    def period_ns(self) -> float | None:
        """The median period of the frames released last; None before the second one."""
        periods = [b - a for a, b in pairwise(self._recent)]
        return median(periods) if periods else None

    def _before_first(self) -> int:
        """A time before all stamps of the window but those that are far too early."""
        stamps = [frame.stamp_ns for frame in self._window]
        if len(stamps) < _FEWEST:
            return min(stamps) - 1
        return max(min(stamps) - 1, round(median(stamps)) - max(_FAR_NS, 2 * _spread(stamps)))

    def _take(self, frame: Timed[T]) -> Timed[T]:
        self._window.remove(frame)
        self.size_bytes -= frame.size_bytes
        frame.segment, self._last_ns = self._segment, frame.stamp_ns
        self._recent.append(frame.stamp_ns)
        return frame

    def _drop(self, frames: list[Timed[T]]) -> None:
        self.dropped += len(frames)
        self.size_bytes -= sum(frame.size_bytes for frame in frames)
        self._window = [frame for frame in self._window if all(frame is not other for other in frames)]


def _order(frame: Timed[T]) -> tuple[int, int]:
    return frame.stamp_ns, frame.arrival


def _spread(stamps: list[int]) -> int:
    """The span of the middle half of some stamps."""
    ordered = sorted(stamps)
    return ordered[3 * len(ordered) // 4 - 1] - ordered[len(ordered) // 4]
