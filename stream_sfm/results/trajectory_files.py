"""Trajectories as text: TUM (`t x y z qx qy qz qw`), KITTI (the upper three rows of the 4×4 pose), and a CSV table.

All contain `world_from_cam` of the left camera in metres; with one camera in units of the first baseline, which a
comment in the TUM file says.
"""

from typing import Any

import numpy as np

from ..geometry import se3
from ..geometry.se3 import Array
from ..types import FrameEstimate
from .frame_table import frame_table

NAMES = ("trajectory.tum", "trajectory.kitti", "trajectory.csv")


def first_lines(comment: str = "") -> tuple[str, str, str]:
    """Return what the files of these `NAMES` begin with."""
    return f"# {comment}\n" if comment else "", "", ",".join(frame_table([])) + "\n"


def lines_of(estimate: FrameEstimate) -> tuple[str, str, str]:
    """Return the line of a frame in the files of these `NAMES`."""
    row = [column.tolist()[0] for column in frame_table([estimate]).values()]
    kitti = _text(estimate.world_from_cam[:3].ravel().tolist(), " ")
    return _tum(estimate.stamp_ns, row[2:9]), kitti, _text(row, ",")  # columns: number, stamp, position, quaternion


def tum_line(stamp_ns: int, world_from_cam: Array) -> str:
    """Return the line of a pose (4, 4)."""
    quaternion = se3.quat_xyzw_from_matrix(world_from_cam[:3, :3])
    return _tum(stamp_ns, np.concatenate([world_from_cam[:3, 3], quaternion]).tolist())


def _tum(stamp_ns: int, numbers: list[Any]) -> str:
    """The seconds have nine decimals and are exact."""
    sign, ns = ("-", -stamp_ns) if stamp_ns < 0 else ("", stamp_ns)
    return f"{sign}{ns // 10**9}.{ns % 10**9:09d} {_text(numbers, ' ')}"


def _text(values: list[Any], separator: str) -> str:
    """Numbers with twelve digits; integers and texts as they are."""
    return separator.join(f"{x:.12g}" if isinstance(x, float) else str(x) for x in values) + "\n"
