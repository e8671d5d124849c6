"""Progress on standard error: a bar on a terminal, elsewhere a line every ten seconds."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Protocol

from ..wording import printable

if TYPE_CHECKING:
    from ..types import Frame, FrameEstimate

LINE_INTERVAL_S = 10.0  # without a terminal; often enough to see that a run is alive, rare enough for a log file


class Advance(Protocol):
    """Called with the number of things just finished, and with a line to print above the bar if there is one."""

    def __call__(self, finished: int = 1, line: str = "") -> None: ...


@contextmanager
def counter(label: str, unit: str, total: int | None, quiet: bool = False) -> Iterator[Advance]:
    """Shows how many of `total` (None: unknown) are finished, such as "simulate rates: 40 of 600 trials"."""
    if quiet:
        yield lambda finished=1, line="": None
    elif not sys.stderr.isatty():
        yield _lines(label, unit, total)
    else:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        from .printing import rich_console

        columns = (TextColumn(label), BarColumn(), MofNCompleteColumn(), TextColumn(unit), TimeRemainingColumn())
        with Progress(*columns, console=rich_console(stderr=True), transient=True) as bar:
            task = bar.add_task(label, total=total)

            def advance(finished: int = 1, line: str = "") -> None:
                if line:
                    bar.console.print(printable(line), markup=False, highlight=False)
                bar.advance(task, finished)

            yield advance


def _lines(label: str, unit: str, total: int | None) -> Advance:
    started_s = printed_s = time.monotonic()
    done = 0

    def advance(finished: int = 1, line: str = "") -> None:
        nonlocal done, printed_s
        done += finished
        lines, now_s = [printable(line)] if line else [], time.monotonic()
        if now_s - printed_s >= LINE_INTERVAL_S:
            printed_s, elapsed_s = now_s, now_s - started_s
            left = f", about {elapsed_s * (total - done) / done:.0f} s left" if total and done else ""
            count = f"{done} of {total}" if total else str(done)
            lines.append(f"{label}: {count} {unit} after {elapsed_s:.0f} s{left}")
        for text in lines:
            with suppress(BrokenPipeError):  # nobody reads it: no reason to end the run
                print(text, file=sys.stderr, flush=True)

    return advance


class ProgressSink:
    """A sink that counts frames and, if `verbose`, reports every change of status."""

    def __init__(self, advance: Advance, verbose: bool) -> None:
        self._advance, self._verbose = advance, verbose
        self._status = ""

    def write(self, estimate: "FrameEstimate", frame: "Frame") -> None:
        """Count one frame."""
        line = ""
        if self._verbose and estimate.status != self._status:
            line = ": ".join(filter(None, (f"frame {estimate.frame_index}", estimate.status, estimate.reason)))
            self._status = estimate.status
        self._advance(1, line)

    def close(self) -> None:
        """Nothing to finish: the bar disappears with its context."""


@contextmanager
def frame_progress(label: str, total: int | None, quiet: bool, verbose: bool = False) -> Iterator[ProgressSink]:
    """A sink that shows how many of `total` frames (None: unknown) have been estimated."""
    with counter(label, "frames", total, quiet) as advance:
        yield ProgressSink(advance, verbose)
