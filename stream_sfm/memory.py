"""Memory that the system refuses: how libraries say so, and whether there is enough to begin with."""

import errno
import mmap

# What Python, NumPy and OpenCV map when they are imported, and the buffers of two threads: measured 350 MiB at least.
# OpenBLAS ends the process itself where it is refused its buffer.
_NEEDED_BYTES = 352 * 2**20
_OPENCV_NO_MEMORY = -4
_BY_LOADER = ("failed to map segment", "cannot allocate memory", "Cannot allocate memory")


def is_enough() -> bool:
    """Whether the process may have the address space that its libraries need."""
    try:
        with mmap.mmap(-1, _NEEDED_BYTES, flags=mmap.MAP_PRIVATE, prot=mmap.PROT_READ):  # only address space
            return True
    except OSError:
        return False


def is_refused(error: BaseException) -> bool:
    """Whether an error says that memory was refused."""
    match error:
        case MemoryError():
            return True
        case OSError():
            return error.errno == errno.ENOMEM
        case ImportError():
            return any(words in str(error) for words in _BY_LOADER)
        case RuntimeError():
            return "can't start new thread" in str(error)  # for whose stack there is no room
    return type(error).__module__ == "cv2" and getattr(error, "code", 0) == _OPENCV_NO_MEMORY
