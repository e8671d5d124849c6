"""Signals as data: a run notices Ctrl-C and SIGTERM between two frames and ends by itself."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def signals_noted() -> Iterator[list[int]]:
    """Within, the first SIGINT or SIGTERM is put into the list instead of being acted on; a second one acts.

    Signals can be handled in the main thread only; elsewhere the list stays empty.
    """
    noted: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield noted
        return
    kinds = (signal.SIGINT, signal.SIGTERM)
    before = {kind: signal.getsignal(kind) for kind in kinds}

    def restore() -> None:
        for kind, handler in before.items():
            signal.signal(kind, handler if handler is not None else signal.SIG_DFL)

    def note(number: int, _frame: Any) -> None:
        noted.append(number)
        restore()

    for kind in kinds:
        signal.signal(kind, note)
    try:
        yield noted
    finally:
        restore()
