"""Ctrl-C and SIGTERM as data: a run checks between two frames whether to end, and then ends in order."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any


@dataclass(slots=True)
class Interruption:
    """Whether the run has been asked to end."""

    requested: bool = False


@contextmanager
def deferred_interrupts() -> Iterator[Interruption]:
    """Let the first SIGINT or SIGTERM only set `requested` while the context lasts; a second one acts as usual.

    Signals can be handled in the main thread only; in another thread nothing changes.
    """
    interruption = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield interruption
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)

    def defer(_number: int, _stack: Any) -> None:
        interruption.requested = True
        restore()

    for number in before:
        signal.signal(number, defer)
    try:
        yield interruption
    finally:
        restore()
