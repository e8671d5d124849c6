"""Trajectories as text: TUM (`t x y z qx qy qz qw`) and KITTI (one row per frame, the twelve numbers of a 3×4 pose).

Both contain `world_from_cam` of the left camera in metres; with one camera in units of the first baseline, which a
comment in the TUM file says. Lines are written as estimates come, under a temporary name; `close` moves the file into
place.
"""

from pathlib import Path

from ..files import PartFile
from ..geometry import se3
from ..geometry.se3 import Array
from ..sources import pose_files
from ..types import Frame, FrameEstimate, Trajectory


class TumWriter:
    """Writes `trajectory.tum`; seconds have nine decimals, taken from the integer stamp without a float between."""

    def __init__(self, path: str | Path, comment: str = "") -> None:
        self._file = PartFile(path)
        if comment:
            self._file.write(f"# {comment}\n".encode())

    def write(self, estimate: FrameEstimate, frame: Frame | None = None) -> None:
        """Append one line."""
        self._file.write((tum_line(estimate.stamp_ns, estimate.world_from_cam) + "\n").encode())
        self._file.flush()

    def close(self) -> None:
        """Move the file into place."""
        self._file.close()


class KittiWriter:
    """Writes `trajectory.kitti`: one row per frame, row-major, no stamps."""

    def __init__(self, path: str | Path) -> None:
        self._file = PartFile(path)

    def write(self, estimate: FrameEstimate, frame: Frame | None = None) -> None:
        """Append one line."""
        self._file.write((kitti_line(estimate.world_from_cam) + "\n").encode())
        self._file.flush()

    def close(self) -> None:
        """Move the file into place."""
        self._file.close()


def tum_line(stamp_ns: int, world_from_cam: Array) -> str:
    """The line `t x y z qx qy qz qw` of a pose (4, 4)."""
    numbers = [*world_from_cam[:3, 3], *se3.quat_xyzw_from_matrix(world_from_cam[:3, :3])]
    sign, ns = ("-", -stamp_ns) if stamp_ns < 0 else ("", stamp_ns)
    return f"{sign}{ns // 10**9}.{ns % 10**9:09d} " + " ".join(f"{x:.12g}" for x in numbers)


def kitti_line(world_from_cam: Array) -> str:
    """The line with the upper three rows of a pose (4, 4)."""
    return " ".join(f"{x:.12g}" for x in world_from_cam[:3].ravel())


def read_tum(path: str | Path) -> Trajectory:
    """Read a TUM file; stamps come back to the nanosecond. Raises InputError naming the line."""
    return pose_files.read_tum(Path(path))
