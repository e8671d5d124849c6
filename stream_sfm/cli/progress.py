"""Progress on standard error: a bar on a terminal, elsewhere a line every ten seconds."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Protocol

from ..system.wording import printable

if TYPE_CHECKING:
    from ..types import Frame, FrameEstimate

_FIRST = 2  # steps before a time is shown: the first one loads or renders
_KEPT = 512  # entries of a history, in which older ones are thinned
LINE_INTERVAL_S = 10.0  # without a terminal; often enough to show that a run is alive, rare enough for a log file


class Advance(Protocol):
    """Called with the number of things just finished, a line to print above the bar, and the amount of work."""

    def __call__(self, finished: int = 1, line: str = "", work: float | None = None) -> None: ...


class Remaining:
    """The remaining time, by the pace in the second half of the finished work, as the start may be slower or faster.

    `total`: all the work, in any unit; None: unknown.
    """

    def __init__(self, total: float | None) -> None:
        self._total = total
        self._history = [(time.monotonic(), 0.0)]  # times, and the work done by then

    def add(self, work: float) -> None:
        """Record that this much work has just been done."""
        self._history.append((time.monotonic(), self._history[-1][1] + work))
        if len(self._history) > _KEPT:
            del self._history[1:-1:2]

    def text(self) -> str:
        """Return a text such as "about 40 s left"; empty if it is not known."""
        now_s, done = self._history[-1]
        half_s, at_half = next(entry for entry in reversed(self._history) if 2 * entry[1] <= done)
        if not self._total or len(self._history) <= _FIRST + 1 or done <= at_half or now_s <= half_s:
            return ""
        left_s = (self._total - done) * (now_s - half_s) / (done - at_half) - (time.monotonic() - now_s)
        return f"about {_duration(max(left_s, 0.0))} left"


@contextmanager
def counter(
    label: str, unit: str, total: int | None, quiet: bool = False, work: float | None = None
) -> Iterator[Advance]:
    """Shows how many of `total` (None: unknown) are finished, such as "simulate rates: 40 of 600 trials".

    `work`: that of all of them if they differ; otherwise all are equal.
    """
    remaining = Remaining(total if work is None else work)
    if quiet:
        yield lambda finished=1, line="", work=None: None
    elif not sys.stderr.isatty():
        yield _lines(label, unit, total, remaining)
    else:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

        from .printing import rich_console

        columns = (
            TextColumn(label),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn(unit),
            TextColumn("{task.fields[left]}"),
        )
        with Progress(*columns, console=rich_console(stderr=True), transient=True) as bar:
            task = bar.add_task(label, total=total, left="")

            def advance(finished: int = 1, line: str = "", work: float | None = None) -> None:
                if line:
                    bar.console.print(printable(line), markup=False, highlight=False)
                remaining.add(finished if work is None else work)
                bar.update(task, advance=finished, left=remaining.text())

            yield advance


def _lines(label: str, unit: str, total: int | None, remaining: Remaining) -> Advance:
    started_s = printed_s = time.monotonic()
    done = 0

    def advance(finished: int = 1, line: str = "", work: float | None = None) -> None:
        nonlocal done, printed_s
        done += finished
        remaining.add(finished if work is None else work)
        lines, now_s = [printable(line)] if line else [], time.monotonic()
        if now_s - printed_s >= LINE_INTERVAL_S:
            printed_s, elapsed_s = now_s, now_s - started_s
            left = f", {text}" if (text := remaining.text()) else ""
            count = f"{done} of {total}" if total else str(done)
            lines.append(f"{label}: {count} {unit} after {_duration(elapsed_s)}{left}")
        for text in lines:
            with suppress(BrokenPipeError):  # if nobody reads it, the run still continues
                print(text, file=sys.stderr, flush=True)

    return advance


def _duration(seconds: float) -> str:
    """Return seconds, or minutes and hours for long times."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60} min"


class ProgressSink:
    """A sink that counts frames and, if `verbose`, reports every change of status."""

    def __init__(self, advance: Advance, verbose: bool) -> None:
        self._advance, self._verbose = advance, verbose
        self._status = ""

    def write(self, estimate: "FrameEstimate", frame: "Frame") -> None:
        line = ""
        if self._verbose and estimate.status != self._status:
            line = ": ".join(filter(None, (f"frame {estimate.frame_index}", estimate.status, estimate.reason)))
            self._status = estimate.status
        self._advance(1, line)

    def close(self) -> None:
        """Do nothing: the bar disappears with its context."""


@contextmanager
def frame_progress(label: str, total: int | None, quiet: bool, verbose: bool = False) -> Iterator[ProgressSink]:
    """A sink that shows how many of `total` frames (None: unknown) have been estimated."""
    with counter(label, "frames", total, quiet) as advance:
        yield ProgressSink(advance, verbose)
