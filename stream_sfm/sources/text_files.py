"""Text files of data sets: tables, stamps in seconds or nanoseconds, with errors that name file and line."""

from collections.abc import Iterator, Sequence
from decimal import Decimal
from io import StringIO
from itertools import pairwise
from pathlib import Path

from ..errors import LogError
from ..inputs import INT64, LIMITS, read_small, reading

_NANOSECOND_DIGITS = 13  # a whole number of so many digits is in nanoseconds: in seconds it would be the year 31690


def read_text(path: Path, what: str) -> str:
    """The content of a text file; `what` names it in errors. Raises LogError."""
    try:
        with reading(f"{what} {path}"):
            return read_small(path, LIMITS.text_bytes).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise LogError(f"{what} {path} is not a text file") from None


def read_table(path: Path, what: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of each line and its cells, separated by commas or white space; lines with `#` are left out.

    Raises LogError.
    """
    for number, line in enumerate(StringIO(read_text(path, what)), start=1):
        if number > LIMITS.indexed or len(line) > LIMITS.name:
            many = (
                f"more than {LIMITS.indexed} lines"
                if number > LIMITS.indexed
                else f"a line of {len(line)} characters"
            )
            raise LogError(f"{what} {path} has {many}: is it another file?")
        if line.strip() and not line.lstrip().startswith("#"):
            cells = line.split(",") if "," in line else line.split()
            yield number, [cell.strip() for cell in cells]


def stamp_ns(text: str, where: str) -> int:
    """A time in nanoseconds: decimal seconds, exactly, or a whole number of nanoseconds. Raises LogError."""
    try:
        whole = text.isdecimal() and len(text) >= _NANOSECOND_DIGITS
        ns = Decimal(text) * (1 if whole else 1_000_000_000)
        if not abs(ns) < INT64 - 1:
            raise ValueError
        return round(ns)
    except (ArithmeticError, ValueError):
        raise LogError(f"{where}: {text!r} is not a time in seconds or whole nanoseconds") from None


def check_ascending(stamps_ns: Sequence[int], where: str | Path) -> None:
    """Raise LogError naming the first entry where time does not advance, or is negative."""
    if stamps_ns and stamps_ns[0] < 0:
        raise LogError(f"{where}: the first stamp is negative ({stamps_ns[0]} ns)")
    for number, (a, b) in enumerate(pairwise(stamps_ns), start=2):
        if b <= a:
            raise LogError(
                f"{where}: entry {number} ({b} ns) is not later than the one before it: sort the entries"
            )
