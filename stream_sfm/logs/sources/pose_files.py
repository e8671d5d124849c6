"""Text files of data sets, with errors that name file and line: tables, stamps, and poses.

Poses have the format of TUM (`t x y z qx qy qz qw`), EuRoC's CSV, or KITTI (twelve numbers of a 3×4 pose per line).
Stamps are in seconds or nanoseconds.
"""

from array import array
from collections.abc import Iterator, Sequence
from decimal import Decimal
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import LogError
from ...geometry import Array, se3
from ...system.inputs import INT64, LIMITS, read_small, reading
from ...types import Trajectory

_UNIT_NORMS = (0.9, 1.1)  # accepted norms of a quaternion: some files have only four digits
_KITTI = "a pose of 12 numbers"
_NANOSECOND_DIGITS = 13  # of a whole number in nanoseconds: in seconds it would be the year 31690


def read_text(path: Path, what: str) -> str:
    """Return the content of a text file; `what` names it in errors. Raises LogError."""
    try:
        with reading(f"{what} {path}"):
            return read_small(path, LIMITS.text_bytes).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise LogError(f"{what} {path} is not a text file") from None


def read_table(path: Path, what: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of each line and its cells, separated by `;`, `,` or white space; lines with `#` are skipped.

    Raises LogError.
    """
    for number, line in enumerate(StringIO(read_text(path, what)), start=1):
        if number > LIMITS.indexed:
            raise LogError(f"{what} {path} has more than {LIMITS.indexed} lines: is it another file?")
        if len(line) > LIMITS.name:
            raise LogError(f"{what} {path} has a line of {len(line)} characters: is it another file?")
        if line.strip() and not line.lstrip().startswith("#"):
            cells = line.split(next((mark for mark in ";," if mark in line), None))
            yield number, [cell.strip() for cell in cells]


def stamp_ns(text: str, where: str) -> int:
    """Parse a time in nanoseconds from decimal seconds, exactly, or whole nanoseconds. Raises LogError."""
    try:
        whole = text.isdecimal() and len(text) >= _NANOSECOND_DIGITS
        ns = Decimal(text) * (1 if whole else 1_000_000_000)
        if not abs(ns) < INT64 - 1:
            raise ValueError
        return round(ns)
    except (ArithmeticError, ValueError):
        raise LogError(f"{where}: {text!r} is not a time in seconds or whole nanoseconds") from None


def check_ascending(stamps_ns: Sequence[int], where: str | Path) -> None:
    """Raise a LogError that names the first stamp that does not increase or is negative."""
    if stamps_ns and stamps_ns[0] < 0:
        raise LogError(f"{where}: the first stamp is negative ({stamps_ns[0]} ns)")
    for number, (a, b) in enumerate(pairwise(stamps_ns), start=2):
        if b <= a:
            raise LogError(f"{where}: entry {number} ({b} ns) is not later than the one before: sort the entries")


def read_poses(path: Path) -> Trajectory:
    """Read the poses of a file in any of the three formats, recognised by the number of columns. Raises LogError.

    KITTI's twelve numbers have no stamps; these are in `times.txt` beside the file, or in front of the twelve.
    """
    columns = len(_first_line(path))
    if is_euroc_table(path):
        return read_euroc(path)
    if columns == 8:
        return read_tum(path)
    if columns == 13:
        rows = _read(path, 12, _KITTI, stamped=True)
        return Trajectory(rows.stamps_ns, _matrices(path, rows))
    if columns == 12:
        times = path.parent / "times.txt"
        if not times.is_file():
            raise LogError(f"{path} has no stamps: put one in front of each line, or a file {times.name} beside it")
        poses, of_lines = read_kitti(path), read_times(times)
        if len(poses) > len(of_lines):
            raise LogError(f"{path} has {len(poses)} poses for {len(of_lines)} times in {times}")
        return Trajectory(np.array(of_lines[: len(poses)], dtype=np.int64), poses)
    raise LogError(
        f"{path}: a line has {columns} columns; supported are TUM (8), EuRoC's CSV (8 or more, the quaternion's w "
        "first) and KITTI (12, or 13 with the stamp)"
    )


def is_euroc_table(path: Path) -> bool:
    """Whether a file is a table of EuRoC, with commas and stamps in whole nanoseconds. Raises LogError."""
    cells = _first_line(path)
    return len(cells) >= 8 and cells[0].isdecimal() and "," in read_text(path, "poses")


def read_tum(path: Path) -> Trajectory:
    """Read a TUM file; stamps are exact to the nanosecond. Raises LogError naming the line."""
    return _with_quaternions(path, (3, 4, 5, 6), "`t x y z qx qy qz qw`")


def read_euroc(path: Path) -> Trajectory:
    """Read a table of EuRoC: stamp, position, quaternion with w first; the body in the world. Raises LogError."""
    return _with_quaternions(path, (4, 5, 6, 3), "a stamp, a position and a quaternion (w, x, y, z)")


def read_kitti(path: Path) -> Array:
    """Read the poses (n, 4, 4) of a KITTI file, which has no stamps. Raises LogError."""
    return _matrices(path, _read(path, 12, _KITTI))


def read_times(path: Path) -> list[int]:
    """Read the stamps of a file with one per line, ascending. Raises LogError."""
    stamps = [stamp_ns(cells[0], f"{path}, line {n}") for n, cells in read_table(path, "times")]
    check_ascending(stamps, path)
    return stamps


def read_rows(path: Path, columns: int, form: str) -> Array:
    """Read the numbers (n, columns) of a file with poses and no stamps. Raises LogError naming the line."""
    return _read(path, columns, form).values


def read_stamped(path: Path, columns: int, form: str) -> tuple[list[int], Array]:
    """Read the ascending stamps and numbers (n, columns) of a file; more columns may follow. Raises LogError."""
    rows = _read(path, columns, form, stamped=True, more=True)
    return rows.stamps_ns.tolist(), rows.values


class _Rows(NamedTuple):
    """The numbers (n, k) of a file, their stamps if it has any, and their line numbers."""

    values: Array
    stamps_ns: NDArray[np.int64]
    lines: Sequence[int]


def _read(path: Path, columns: int, form: str, stamped: bool = False, more: bool = False) -> _Rows:
    """Read lines of `columns` finite numbers, after ascending stamps if `stamped`; `more` columns may follow."""
    lines, stamps, numbers = array("q"), array("q"), array("d")  # arrays, as there may be millions
    for number, cells in read_table(path, "poses"):
        where = f"{path}, line {number}"
        try:
            values = [float(cell) for cell in (cells[: columns + stamped] if more else cells)[stamped:]]
        except ValueError:
            values = []
        if len(values) != columns or not np.isfinite(values).all():
            raise LogError(f"{where} is not {form}: {' '.join(cells)[:60]!r}")
        if stamped:
            stamps.append(stamp_ns(cells[0], where))
            if len(stamps) > 1 and stamps[-1] <= stamps[-2]:
                raise LogError(f"{where}: its stamp is not later than the one before: sort the lines")
        lines.append(number)
        numbers.extend(values)
    return _Rows(np.array(numbers).reshape(-1, columns), np.array(stamps), lines)


def _first_line(path: Path) -> list[str]:
    for _, cells in read_table(path, "poses"):
        return cells
    raise LogError(f"{path} holds no pose")


def _with_quaternions(path: Path, columns: tuple[int, int, int, int], form: str) -> Trajectory:
    """Read poses; `columns`: those of x, y, z, w after the stamp."""
    rows = _read(path, 7, form, stamped=True, more=True)
    quaternions = rows.values[:, columns]
    norms = np.linalg.norm(quaternions, axis=1)
    if (wrong := np.flatnonzero((norms <= _UNIT_NORMS[0]) | (norms >= _UNIT_NORMS[1]))).size:
        one = quaternions[wrong[0]].tolist()
        raise LogError(f"{path}, line {rows.lines[wrong[0]]}: the quaternion {one} is not of length 1")
    rotations = se3.matrix_from_quat_xyzw(quaternions)
    return Trajectory(rows.stamps_ns, se3.from_rotation_translation(rotations, rows.values[:, :3]))


def _matrices(path: Path, rows: _Rows) -> Array:
    if not rows.lines:
        raise LogError(f"{path} holds no pose")
    poses = np.tile(np.eye(4), (len(rows.lines), 1, 1))
    poses[:, :3] = rows.values.reshape(-1, 3, 4)
    rotations = poses[:, :3, :3]
    if (mirrored := np.flatnonzero(se3.is_rotation(-rotations, se3.ROUNDED))).size:
        raise LogError(f"{path}, line {rows.lines[mirrored[0]]}: the pose is mirrored: use right-handed axes")
    if not se3.is_rotation(rotations, se3.ROUNDED).all():
        raise LogError(f"{path}: the first 3×3 numbers of a line are not a rotation: is it KITTI's format?")
    return se3.orthonormalise(poses)
