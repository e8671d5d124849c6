"""Files that get their name only when they are complete, and JSON as every file of the package holds it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import msgspec

from .errors import OutputError


class PartFile:
    """A binary file that is written as `<name>.part` and renamed to `<name>` by `close`.

    If the process is killed, what was flushed is left under the temporary name. Raises OutputError naming the file if
    the disk refuses; the file then takes no more data and keeps its temporary name, so that a file under its final
    name never has a gap.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.part_path = self.path.with_name(self.path.name + ".part")
        self._failure: OutputError | None = None
        try:
            self._file: IO[bytes] = open(self.part_path, "wb")  # noqa: SIM115
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror}") from None

    def write(self, data: bytes) -> int:
        """Append bytes."""
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
        finally:
            with suppress(OSError):  # a second failure to flush the same bytes
                self._file.close()
        with self._or_fail():
            os.replace(self.part_path, self.path)

    @contextmanager
    def _or_fail(self) -> Iterator[None]:
        if self._failure is not None:
            raise self._failure
        try:
            yield
        except OSError as error:
            self._failure = OutputError(
                f"cannot write {self.path}: {error.strerror}; what was written before is in {self.part_path}"
            )
            raise self._failure from None


def write_whole(path: str | Path, *parts: bytes) -> None:
    """Write a file in one go. Raises OutputError naming it."""
    file = PartFile(path)
    for part in parts:
        file.write(part)
    file.close()


def json_bytes(value: Any) -> bytes:
    """Return indented JSON with a final newline; numbers that are not finite become null."""
    return msgspec.json.format(msgspec.json.encode(value), indent=2) + b"\n"
