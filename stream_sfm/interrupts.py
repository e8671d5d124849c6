"""Ctrl-C and SIGTERM as data: a run looks between two frames whether it should end, and ends by itself."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any


@dataclass(slots=True)
class Interruption:
    """Whether somebody wants the run to end."""

    requested: bool = False


@contextmanager
def deferred_interrupts() -> Iterator[Interruption]:
    """Within, the first SIGINT or SIGTERM sets `requested` and does nothing else; a second one acts as usual.

    Signals can be handled in the main thread only; in another one nothing changes.
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
