"""Files that get their name only when they are complete, and the JSON of all files of the package."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import msgspec

from ..errors import OutputError, as_error
from .outputs import try_lock


def make_folder(path: Path) -> None:
    """Create a folder and its parents if they do not exist. Raises OutputError."""
    with as_error(OutputError, f"cannot make the folder {path}", OSError):
        path.mkdir(parents=True, exist_ok=True)


class PartFile:
    """A binary file that is written as `<name>.part` and renamed to `<name>` by `close`.

    If the process is killed, flushed data remains under the temporary name. If writing fails, an OutputError names
    the file; it then takes no more data and keeps its temporary name, so that a file under its final name never has
    a gap. The temporary file is always new: the remains of an ended run are removed, links are not followed, and if
    another run is writing the file, an OutputError says so. Without `keep`, for files of which a part is useless, a
    failure removes it.
    """

    def __init__(self, path: str | Path, *, keep: bool = True) -> None:
        self.path = Path(path)
        self._keep = keep
        self.part_path = self.path.with_name(self.path.name + ".part")
        self._failure: OutputError | None = None
        with as_error(OutputError, f"cannot write {self.path}", OSError):
            self._file: IO[bytes] = _create(self.part_path)

    def write(self, data: bytes) -> int:
        with self._or_fail():
            return self._file.write(data)

    def flush(self) -> None:
        """Pass everything on to the operating system."""
        with self._or_fail():
            self._file.flush()

    def tell(self) -> int:
        """Return the number of bytes written so far."""
        return self._file.tell()

    def close(self) -> None:
        """Flush and rename the file; a second call does nothing."""
        if self._file.closed:
            return
        try:
            with self._or_fail():
                self._file.flush()
                self._check_it_is_ours()
                os.replace(self.part_path, self.path)
        finally:
            with suppress(OSError):  # flushing the same bytes may fail a second time
                self._file.close()

    def discard(self) -> None:
        """Remove what was written, unless it already has its final name."""
        if self._file.closed:
            return
        with suppress(OSError):
            self._check_it_is_ours()
            self.part_path.unlink()
        with suppress(OSError):
            self._file.close()

    def __enter__(self) -> "PartFile":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close the file, or discard it if an error ends the context."""
        if kind is None:
            self.close()
        else:
            self.discard()

    def _check_it_is_ours(self) -> None:
        ours, found = os.fstat(self._file.fileno()), os.lstat(self.part_path)
        if (ours.st_dev, ours.st_ino) != (found.st_dev, found.st_ino):
            raise OSError(errno.ESTALE, f"{self.part_path} was replaced by another process")

    @contextmanager
    def _or_fail(self) -> Iterator[None]:
        if self._failure is not None:
            raise self._failure
        try:
            yield
        except OSError as error:
            kept = f"; what was written before is in {self.part_path}" if self._keep else ""
            self._failure = OutputError(f"cannot write {self.path}: {error.strerror}{kept}")
            if not self._keep:
                self.discard()
            raise self._failure from None


def _create(path: Path) -> IO[bytes]:
    """Create a file that is locked while it is open."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
    try:
        descriptor = os.open(path, flags, 0o666)
    except FileExistsError:
        _remove_left_over(path)
        descriptor = os.open(path, flags, 0o666)
    try_lock(descriptor)
    return os.fdopen(descriptor, "wb")


def _remove_left_over(path: Path) -> None:
    """Remove a file under the name of a temporary file, unless it is being written."""
    if not path.is_symlink() and path.is_file():
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        try:
            if not try_lock(descriptor):
                raise OSError(errno.EBUSY, f"another run is writing {path}")
        finally:
            os.close(descriptor)
    path.unlink()


def write_whole(path: str | Path, *parts: bytes) -> None:
    """Write a file at once. Raises OutputError naming it."""
    file = PartFile(path)
    for part in parts:
        file.write(part)
    file.close()


def json_bytes(value: Any) -> bytes:
    """Return indented JSON with a final newline; numbers that are not finite become null."""
    return msgspec.json.format(msgspec.json.encode(value), indent=2) + b"\n"
