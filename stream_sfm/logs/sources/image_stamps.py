"""The stamps of image files: in their names, or in a table beside them, one column of which has the names."""

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from statistics import median

from ...errors import LogError
from .pose_files import check_ascending, read_table, stamp_ns

# Times since 1970: digits of a whole number (today and for 200 years) -> its unit in nanoseconds; or seconds.
_UNITS_NS = {19: 1, 16: 1_000, 13: 1_000_000}
_SECONDS = re.compile(r"\d{10}\.\d{1,9}")
_IN_NAME = re.compile(r"(?<!\d)(?:\d{10}\.\d{1,9}|\d{19}|\d{16}|\d{13})(?!\d)")
_SUFFIXES = (".csv", ".txt")
_MOST_TABLES = 20  # per folder; more are something else
_LEAST_PERIOD_NS = 100_000  # of any camera; whole numbers that grow by less count the images


def named_stamps(files: Sequence[Path]) -> list[int] | None:
    """Return the ascending stamps that the names of the files are or contain; None if they do not."""
    names = [file.stem for file in files]
    if all(_unit_ns(name) is not None for name in names):
        stamps = [_ns(name) for name in names]
        if files:
            check_ascending(stamps, files[0].parent)
        return stamps
    found = [_IN_NAME.findall(name) for name in names]
    if any(len(times) != 1 for times in found):
        return None
    stamps = [_ns(time) for (time,) in found]
    return stamps if _ascending(stamps) else None  # a number of this length may be something else


def listed_stamps(files: Sequence[Path], folder: Path) -> tuple[list[int], Path] | None:
    """Return the stamps of the files in a table that lists them, and the table; None if there is none.

    Tables lie in the `folder` of the recording, or beside the files or their folder. A name may come with folders.
    """
    if not files:
        return None
    for path in _tables(dict.fromkeys([files[0].parent, files[0].parent.parent, folder])):
        with suppress(LogError):  # another file
            if (stamps := _listed(path, [file.name for file in files])) is not None:
                return stamps, path
    return None


def _tables(folders: Sequence[Path] | dict[Path, None]) -> Iterator[Path]:
    for folder in folders:
        with suppress(OSError):
            found = sorted(p for p in folder.iterdir() if p.suffix.lower() in _SUFFIXES and p.is_file())
            yield from found if len(found) <= _MOST_TABLES else ()


def _listed(path: Path, names: Sequence[str]) -> list[int] | None:
    """Return the stamps of these names, in the first column of the table that can be times; None if there is none."""
    wanted = {key for name in names for key in (name, Path(name).stem)}
    rows: dict[str, list[str]] = {}
    for _, cells in read_table(path, "times"):
        for cell in cells:
            if (name := cell.replace("\\", "/").split("/")[-1]) in wanted:
                rows[Path(name).stem if name in names else name] = [c for c in cells if c is not cell]
                break
    of_names = [rows.get(Path(name).stem) for name in names]
    found = [cells for cells in of_names if cells is not None]
    if len(found) < len(names):
        return None
    for column in zip(*found, strict=False):
        with suppress(LogError):
            stamps = [_ns(cell) for cell in column]
            if _ascending(stamps):
                return stamps
    return None


def _unit_ns(text: str) -> int | None:
    """Return the unit of a time since 1970; None if a text is none."""
    return _UNITS_NS.get(len(text)) if text.isdecimal() else 1 if _SECONDS.fullmatch(text) else None


def _ns(text: str) -> int:
    """Return a time in nanoseconds: since 1970 in any unit, or seconds with decimals, or whole nanoseconds."""
    if text.isdecimal():
        return int(text) * _UNITS_NS.get(len(text), 1)
    return stamp_ns(text, text)


def _ascending(stamps_ns: Sequence[int]) -> bool:
    steps = [b - a for a, b in pairwise(stamps_ns)]
    return stamps_ns[0] >= 0 and min(steps, default=1) > 0 and median(steps or [_LEAST_PERIOD_NS]) >= _LEAST_PERIOD_NS
