"""Memory that the system refuses: how libraries report it, and whether there is enough to start."""

import errno
import mmap

# Python, NumPy and OpenCV map 370 MiB on import, with the buffers of three threads; a run that has 410 may be refused
# more when it ends.
# OpenBLAS ends the process itself if it is refused its buffer.
_NEEDED_BYTES = 416 * 2**20
_OPENCV_NO_MEMORY = -4
_BY_LOADER = ("failed to map segment", "cannot allocate memory", "Cannot allocate memory")


def is_enough() -> bool:
    """Whether the process may have the address space that its libraries need."""
    try:
        with mmap.mmap(-1, _NEEDED_BYTES, flags=mmap.MAP_PRIVATE, prot=mmap.PROT_READ):  # address space only
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
            return "can't start new thread" in str(error)  # there is no room for its stack
    if type(error).__name__ == "ZstdError":
        return "not enough memory" in str(error)
    return type(error).__module__ == "cv2" and getattr(error, "code", 0) == _OPENCV_NO_MEMORY
