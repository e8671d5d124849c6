"""Trajectories as text: TUM (`t x y z qx qy qz qw`), KITTI (the upper three rows of the 4×4 pose), and a CSV table.

All contain `world_from_cam` of the left camera in metres; with one camera in units of the first baseline, which a
comment in the TUM file says.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..files import PartFile
from ..geometry import se3
from ..geometry.se3 import Array
from ..types import Frame, FrameEstimate
from .frame_table import frame_table


class LineWriter:
    """A sink that writes a line per frame as it comes, under a temporary name until it is closed."""

    def __init__(self, path: str | Path, line_of: Callable[[FrameEstimate], str], first_line: str = "") -> None:
        self._file, self._line_of = PartFile(path), line_of
        if first_line:
            self._file.write(f"{first_line}\n".encode())

    def write(self, estimate: FrameEstimate, frame: Frame | None = None) -> None:
        """Append one line."""
        self._file.write(f"{self._line_of(estimate)}\n".encode())
        self._file.flush()

    def close(self) -> None:
        """Move the file into place."""
        self._file.close()


def tum_writer(path: str | Path, comment: str = "") -> LineWriter:
    """Return a sink that writes `trajectory.tum`."""
    return LineWriter(path, lambda e: tum_line(e.stamp_ns, e.world_from_cam), comment and f"# {comment}")


def kitti_writer(path: str | Path) -> LineWriter:
    """Return a sink that writes `trajectory.kitti`, which has no stamps."""
    return LineWriter(path, lambda e: " ".join(f"{x:.12g}" for x in e.world_from_cam[:3].ravel()))


def csv_writer(path: str | Path) -> LineWriter:
    """Return a sink that writes `trajectory.csv`: a line of names, then the row of each frame."""
    return LineWriter(path, _csv_line, ",".join(frame_table([])))


def tum_line(stamp_ns: int, world_from_cam: Array) -> str:
    """Return the line of a pose (4, 4); its seconds have nine decimals and are exact."""
    numbers = [*world_from_cam[:3, 3], *se3.quat_xyzw_from_matrix(world_from_cam[:3, :3])]
    sign, ns = ("-", -stamp_ns) if stamp_ns < 0 else ("", stamp_ns)
    return f"{sign}{ns // 10**9}.{ns % 10**9:09d} " + " ".join(f"{x:.12g}" for x in numbers)


def _csv_line(estimate: FrameEstimate) -> str:
    row = [column[0] for column in frame_table([estimate]).values()]
    return ",".join(f"{value:.12g}" if isinstance(value, np.floating) else str(value) for value in row)
