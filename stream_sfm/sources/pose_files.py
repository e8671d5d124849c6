"""Poses in text files: TUM (`t x y z qx qy qz qw`), EuRoC's CSV, KITTI (twelve numbers of a 3×4 pose per line)."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import LogError
from ..geometry import se3
from ..geometry.se3 import Array
from ..types import Trajectory
from .text_files import check_ascending, read_table, read_text, stamp_ns

_UNIT_NORMS = (0.9, 1.1)  # of a quaternion: files give as few as four digits
_ROTATION_TOLERANCE = 1e-2  # of R Rᵀ from the identity, for the same reason
_Line = tuple[int, list[str]]  # its number and its cells


def read_poses(path: Path) -> Trajectory:
    """The poses of a file in any of the three formats, recognised by the number of columns. Raises LogError.

    KITTI's twelve numbers have no stamps: they are in `times.txt` beside the file, or in front of the twelve.
    """
    columns = len(_first_line(path))
    if is_euroc_table(path):
        return read_euroc(path)
    if columns == 8:
        return read_tum(path)
    if columns == 13:
        rows = list(read_table(path, "poses"))
        stamps = _ascending(path, [(n, stamp_ns(cells[0], f"{path}, line {n}")) for n, cells in rows])
        return Trajectory(stamps, _matrices(path, ((n, cells[1:]) for n, cells in rows)))
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
    """Whether a file is a table of EuRoC: cells separated by commas, stamps in whole nanoseconds. Raises LogError."""
    cells = _first_line(path)
    return len(cells) >= 8 and cells[0].isdecimal() and "," in read_text(path, "poses")


def read_tum(path: Path) -> Trajectory:
    """A TUM file; stamps come back to the nanosecond. Raises LogError naming the line."""
    return _with_quaternions(path, (4, 5, 6, 7), "`t x y z qx qy qz qw`")


def read_euroc(path: Path) -> Trajectory:
    """A table of EuRoC: stamp, position, quaternion with w first; the body in the world. Raises LogError."""
    return _with_quaternions(path, (5, 6, 7, 4), "a stamp, a position and a quaternion (w, x, y, z)")


def read_kitti(path: Path) -> Array:
    """The poses (n, 4, 4) of a file of KITTI, which has no stamps. Raises LogError."""
    return _matrices(path, read_table(path, "poses"))


def read_times(path: Path) -> list[int]:
    """The stamps of a file with one per line, ascending. Raises LogError."""
    stamps = [stamp_ns(cells[0], f"{path}, line {n}") for n, cells in read_table(path, "times")]
    check_ascending(stamps, path)
    return stamps


def read_rows(path: Path, columns: int, form: str) -> Array:
    """The numbers (n, columns) of a file with poses and no stamps. Raises LogError naming the line."""
    rows = []
    for number, cells in read_table(path, "poses"):
        if len(values := _numbers(cells)) != columns:
            raise LogError(f"{path}, line {number} is not {form}")
        rows.append(values)
    return np.array(rows).reshape(-1, columns)


def _first_line(path: Path) -> list[str]:
    for _, cells in read_table(path, "poses"):
        return cells
    raise LogError(f"{path} holds no pose")


def _with_quaternions(path: Path, columns: tuple[int, int, int, int], form: str) -> Trajectory:
    """`columns`: of x, y, z, w."""
    stamps: list[tuple[int, int]] = []
    poses: list[Array] = []
    for number, cells in read_table(path, "poses"):
        values = _numbers(cells[:8])
        if len(values) != 8:
            raise LogError(f"{path}, line {number} is not {form}")
        quaternion = values[list(columns)]
        if not _UNIT_NORMS[0] < np.linalg.norm(quaternion) < _UNIT_NORMS[1]:
            raise LogError(f"{path}, line {number}: the quaternion {quaternion.tolist()} is not of length 1")
        stamps.append((number, stamp_ns(cells[0], f"{path}, line {number}")))
        poses.append(se3.from_rotation_translation(se3.matrix_from_quat_xyzw(quaternion), values[1:4]))
    return Trajectory(_ascending(path, stamps), np.array(poses).reshape(-1, 4, 4))


def _matrices(path: Path, rows: Iterable[_Line]) -> Array:
    lines: list[int] = []
    found: list[Array] = []
    for number, cells in rows:
        values = _numbers(cells)
        if len(values) != 12:
            raise LogError(f"{path}, line {number} does not have 12 numbers: {' '.join(cells)[:60]!r}")
        lines.append(number)
        found.append(values.reshape(3, 4))
    if not found:
        raise LogError(f"{path} holds no pose")
    poses = np.tile(np.eye(4), (len(found), 1, 1))
    poses[:, :3] = found
    rotations = poses[:, :3, :3]
    if not np.allclose(rotations @ rotations.swapaxes(1, 2), np.eye(3), atol=_ROTATION_TOLERANCE):
        raise LogError(f"{path}: the first 3×3 numbers of a line are not a rotation: is it KITTI's format?")
    if (mirrored := np.flatnonzero(np.linalg.det(rotations) < 0)).size:
        raise LogError(f"{path}, line {lines[mirrored[0]]}: the pose is mirrored: give poses in right-handed axes")
    return se3.orthonormalise(poses)


def _numbers(cells: list[str]) -> Array:
    """The cells of a line as finite numbers; empty where they are not."""
    try:
        values = np.array([float(cell) for cell in cells])
    except ValueError:
        return np.empty(0)
    return values if np.isfinite(values).all() else np.empty(0)


def _ascending(path: Path, stamps: list[tuple[int, int]]) -> NDArray[np.int64]:
    """The stamps of lines, nanoseconds. Raises LogError naming the first line that is not later than the one before."""
    times = np.array([stamp for _, stamp in stamps], dtype=np.int64)
    late = np.flatnonzero(np.diff(times) <= 0)
    if late.size:
        line = stamps[int(late[0]) + 1][0]
        raise LogError(f"{path}, line {line}: its stamp is not later than the one before: sort the lines")
    return times
