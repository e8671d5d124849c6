"""How the process of a command computes: threads, garbage collection, heap. Set before NumPy and OpenCV are loaded."""

import atexit
import ctypes
import gc
import os
import sys
from contextlib import suppress

from ..system.blas import one_thread

_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")


def settle() -> None:
    """Compute in one thread, unless the environment says otherwise, and in one heap.

    One thread for small matrices and some hundred small patches: waiting threads cost more than they save, and the
    numbers are the same on every machine. Left and right are decoded in threads of their own; glibc would give each of
    them a heap, which together keep 7 MiB of free memory.
    """
    for variable in _THREADS:
        if not os.environ.get(variable, "").isdecimal():  # OpenCV refuses to work with anything else
            os.environ[variable] = "1"
    one_thread.begun_so = "numpy" not in sys.modules and all(os.environ[variable] == "1" for variable in _THREADS)
    if not os.environ.get("SOURCE_DATE_EPOCH", "0").isdecimal():  # numpy.f2py reads it when it is imported
        del os.environ["SOURCE_DATE_EPOCH"]
    # The collector looks for cycles, of which we make hardly any; by default imports alone call it 150 times.
    gc.set_threshold(100_000)
    atexit.register(gc.freeze)  # otherwise Python searches all that is left for cycles, twice, before it exits
    with suppress(OSError, TypeError, AttributeError):  # another C library, which has no such thing
        ctypes.CDLL(None).mallopt(-8, 1)  # M_ARENA_MAX of glibc
