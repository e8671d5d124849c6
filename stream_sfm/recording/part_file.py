"""Files that appear under their name only when they are whole."""

import os
from pathlib import Path
from typing import IO

from ..errors import OutputError


class PartFile:
    """A binary file written as `<name>.part` and moved to `<name>` by `close`.

    What was flushed survives a killed process under the temporary name. Raises OutputError naming the file where
    the disk refuses. `stream` is a file object whose `write` and `flush` do the same.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.part_path = self.path.with_name(self.path.name + ".part")
        try:
            self._file: IO[bytes] = open(self.part_path, "wb")  # noqa: SIM115
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror}") from None

    def write(self, data: bytes) -> int:
        """Append."""
        try:
            return self._file.write(data)
        except OSError as error:
            raise self._failure(error) from None

    def flush(self) -> None:
        """Hand everything over to the operating system."""
        try:
            self._file.flush()
        except OSError as error:
            raise self._failure(error) from None

    def tell(self) -> int:
        """Bytes written so far."""
        return self._file.tell()

    def close(self) -> None:
        """Flush and move into place; nothing the second time."""
        if self._file.closed:
            return
        try:
            self._file.close()
            os.replace(self.part_path, self.path)
        except OSError as error:
            raise self._failure(error) from None

    def _failure(self, error: OSError) -> OutputError:
        return OutputError(
            f"cannot write {self.path}: {error.strerror}; what was written before is in {self.part_path}"
        )
