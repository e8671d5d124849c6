"""Linear algebra in one thread: the same bytes on every machine, and for matrices of this size the fastest.

How many threads share a product decides in which order its sums are formed, and so the last digit of the result.
"""

import sys
import threading
from typing import Any

from threadpoolctl import ThreadpoolController


class OneThread:
    """A context in which BLAS and LAPACK compute in one thread, in the whole process, and as before afterwards.

    It may be entered by several threads at a time: the first one sets the number, the last one restores it.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._inside = 0
        self._controller: ThreadpoolController | None = None  # made late: finding the libraries takes milliseconds
        self._with_scipy = False
        self._limits: Any = None

    def __enter__(self) -> None:
        with self._lock:
            if self._inside == 0:
                with_scipy = "scipy.linalg" in sys.modules  # it brings a library of its own, a fifth of a second
                if self._controller is None or with_scipy != self._with_scipy:
                    self._controller, self._with_scipy = ThreadpoolController(), with_scipy
                _take_control(self._controller)
                self._limits = self._controller.limit(limits=1, user_api="blas")
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if self._inside == 0 and self._controller is not None:
                _take_control(self._controller)
                self._limits.restore_original_limits()


def _take_control(controller: ThreadpoolController) -> None:
    """Let this thread set the number, which threadpoolctl else leaves to the thread that has set it first."""
    for library in controller.lib_controllers:
        if clear := getattr(library, "clear_controlling_thread", None):
            clear(force=True)


one_thread = OneThread()
