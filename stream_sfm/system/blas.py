"""Linear algebra in one thread: it gives the same bytes on every machine, and is fastest for matrices of this size.

The number of threads decides the order of the sums in a product, and so the last digit of the result.
"""

import sys
import threading
from typing import Any


class OneThread:
    """A context in which BLAS and LAPACK compute in one thread, in the whole process, and as before afterwards.

    It may be entered by several threads at a time: the first one sets the number, the last one restores it.
    """

    def __init__(self) -> None:
        self.begun_so = False  # set before the process loaded any library: there is nothing to do
        self._lock = threading.Lock()
        self._inside = 0
        self._libraries: list[Any] = []  # found late, as that takes milliseconds
        self._with_scipy = False
        self._before: list[tuple[Any, int]] = []  # libraries that had another number of threads, with that number

    def __enter__(self) -> None:
        if self.begun_so:
            return
        from threadpoolctl import ThreadpoolController

        with self._lock:
            self._inside += 1
            with_scipy = "scipy.linalg" in sys.modules  # it loads its own library, which takes a fifth of a second
            if not self._libraries or with_scipy != self._with_scipy:
                self._libraries = ThreadpoolController().select(user_api="blas").lib_controllers
                self._with_scipy = with_scipy
            elif self._inside > 1:
                return
            for library in self._libraries:
                if (number := library.num_threads) != 1:
                    self._before.append((library, number))
                    _set_threads(library, 1)

    def __exit__(self, *_: object) -> None:
        if self.begun_so:
            return
        with self._lock:
            self._inside -= 1
            if self._inside == 0:
                while self._before:
                    _set_threads(*self._before.pop())


def _set_threads(library: Any, number: int) -> None:
    """Set the number from this thread, which threadpoolctl otherwise leaves to the first thread that set it."""
    if clear := getattr(library, "clear_controlling_thread", None):
        clear(force=True)
    library.set_num_threads(number)


one_thread = OneThread()
