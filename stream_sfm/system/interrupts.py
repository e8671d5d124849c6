"""Ctrl-C, SIGTERM and SIGHUP as data: a run checks between two frames whether to end, and then ends cleanly.

A signal that is ignored when the process starts, as under nohup or in the background of a script, stays ignored.
Waiting for a frame is bounded as well, because it would delay this check.
"""

import signal
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

T = TypeVar("T")

GRACE_S = 1.0  # time for the current frame; most take a tenth of it
_TERMINATION = (signal.SIGTERM, signal.SIGHUP)  # the last one means a closed terminal or a lost connection
ENDING = (signal.SIGINT, *_TERMINATION)


@dataclass(slots=True)
class Interruption:
    """Whether the run has been asked to end."""

    requested: bool = False
    _waiting: bool = False

    def until_requested(self, items: Iterable[T]) -> Iterator[T]:
        """Yield the items until the run is asked to end; a pending item then has `GRACE_S` to arrive.

        Raises KeyboardInterrupt if not even the first one arrived. Uses the alarm of the process.
        """
        iterator, count = iter(items), 0
        while not self.requested:
            try:
                item = self._next(iterator)
            except StopIteration:
                return
            except KeyboardInterrupt:
                if not (self.requested and count):
                    raise
                return
            count += 1
            yield item

    def _next(self, iterator: Iterator[T]) -> T:
        self._waiting = True
        try:
            return next(iterator)
        finally:
            self._waiting = False
            if self.requested and threading.current_thread() is threading.main_thread():
                signal.setitimer(signal.ITIMER_REAL, 0)

    def request(self) -> None:
        """Ask the run to end, as the signal handlers do."""
        self.requested = True
        if self._waiting:
            signal.signal(signal.SIGALRM, _interrupt)
            signal.setitimer(signal.ITIMER_REAL, GRACE_S)


def _interrupt(*_: Any) -> None:
    raise KeyboardInterrupt


@contextmanager
def termination_as_interrupt() -> Iterator[None]:
    """Make SIGTERM and SIGHUP raise KeyboardInterrupt within the context, as Ctrl-C does, so that a run cleans up.

    Signals that already have a handler do not change, and nothing changes in threads other than the main one.
    """
    main = threading.current_thread() is threading.main_thread()
    own = [number for number in _TERMINATION if main and signal.getsignal(number) is signal.SIG_DFL]
    for number in own:
        signal.signal(number, _interrupt)
    try:
        yield
    finally:
        for number in own:
            signal.signal(number, signal.SIG_DFL)


@contextmanager
def deferred_interrupts() -> Iterator[Interruption]:
    """Make the first ending signal within the context only set `requested`; a second one acts as usual.

    Only the main thread can handle signals; in another thread nothing changes. Ignored signals stay ignored.
    """
    interruption = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield interruption
        return
    handlers = {number: signal.getsignal(number) for number in ENDING}
    before = {number: handler for number, handler in handlers.items() if handler is not signal.SIG_IGN}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)

    def defer(_number: int, _stack: Any) -> None:
        restore()
        interruption.request()

    for number in before:
        signal.signal(number, defer)
    try:
        yield interruption
    finally:
        restore()
