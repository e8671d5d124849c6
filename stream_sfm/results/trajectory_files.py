"""Trajectories as text: TUM (`t x y z qx qy qz qw`), KITTI (the upper three rows of the 4×4 pose), and a CSV table.

All contain `world_from_cam` of the left camera in metres, or with one camera in units of the first baseline, as a
comment in the TUM file says. The columns of the CSV are those of the table of `read_results`.
"""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry import Array, se3
from ..record import about, plain_type
from ..types import FrameEstimate

Table = dict[str, NDArray[Any]]
_NUMBERS: dict[Any, type] = {int: np.int64, float: np.float64}  # columns of these types; all others are text
NAMES = ("trajectory.tum", "trajectory.kitti", "trajectory.csv")
# Fields of an estimate that become columns unchanged, and their types.
_DESCRIBED = {f.name: _NUMBERS.get(plain_type(f), str) for f in fields(FrameEstimate) if about(f).column}


def frame_table(frames: Sequence[FrameEstimate]) -> Table:
    """Return the columns of n frames.

    σ of position and rotation are along and about the axes of the world, radians; NaN where there is none.
    """
    pose = np.array([f.world_from_cam for f in frames], dtype=float).reshape(-1, 4, 4)
    cov = np.array([f.cov_pose for f in frames], dtype=float).reshape(-1, 6, 6)
    std_m, std_rad = (_std_in_world(pose, cov[:, half, half]) for half in (slice(0, 3), slice(3, 6)))
    quaternion = se3.quat_xyzw_from_matrix(pose[:, :3, :3])

    def numbers(names: Sequence[str], columns: Array) -> Table:
        return dict(zip(names, columns.T, strict=True))

    described: Table = {key: np.array([getattr(f, key) for f in frames], of) for key, of in _DESCRIBED.items()}
    return {
        **{name: described.pop(name) for name in ("frame_index", "stamp_ns")},
        **numbers(("x_m", "y_m", "z_m"), pose[:, :3, 3]),
        **numbers(("qx", "qy", "qz", "qw"), quaternion),
        **numbers(("sigma_x_m", "sigma_y_m", "sigma_z_m"), std_m),
        **numbers(("sigma_rx_rad", "sigma_ry_rad", "sigma_rz_rad"), std_rad),
        "sigma_m": np.sqrt((std_m**2).sum(axis=1)),
        **described,
        **{
            f"points_{name}": np.array([f.counts.get(name, 0) for f in frames], dtype=np.int64)
            for name in ("tracked", "new", "used", "rejected")
        },
        "nis_per_dof": np.array([f.nis / f.nis_dof if f.nis_dof else np.nan for f in frames], dtype=float),
    }


def _std_in_world(world_from_cam: Array, cov: Array) -> Array:
    """Return σ (n, 3) along the world's axes of covariances (n, 3, 3) in axes of the cameras (n, 4, 4)."""
    known = np.isfinite(cov).all(axis=(1, 2), keepdims=True)
    turned = world_from_cam[:, :3, :3]
    variances = ((turned @ np.where(known, cov, np.nan)) * turned).sum(axis=2)
    return np.sqrt(np.maximum(variances, 0.0))


def first_lines(comment: str = "") -> tuple[str, str, str]:
    """Return the first lines of the files of these `NAMES`."""
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
    """Return a line of TUM, whose seconds have nine decimals and are exact."""
    sign, ns = ("-", -stamp_ns) if stamp_ns < 0 else ("", stamp_ns)
    return f"{sign}{ns // 10**9}.{ns % 10**9:09d} {_text(numbers, ' ')}"


def _text(values: list[Any], separator: str) -> str:
    """Return numbers with twelve digits; integers and text stay as they are."""
    return separator.join(f"{x:.12g}" if isinstance(x, float) else str(x) for x in values) + "\n"
