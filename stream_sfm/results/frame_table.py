"""One row per frame: the columns of `trajectory.csv`, and of the table of `read_results`."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry import se3
from ..geometry.se3 import Array
from ..types import FrameEstimate

Table = dict[str, NDArray[Any]]


def frame_table(frames: Sequence[FrameEstimate]) -> Table:
    """Return the columns of n frames.

    σ of position and rotation are along and about the axes of the world, radians; NaN where there is none.
    """
    pose = np.array([f.world_from_cam for f in frames], dtype=float).reshape(-1, 4, 4)
    cov = np.array([f.cov_pose for f in frames], dtype=float).reshape(-1, 6, 6)
    quaternion = se3.quat_xyzw_from_matrix(pose[:, :3, :3])
    std_m, std_rad = (_std_in_world(pose, cov[:, half, half]) for half in (slice(0, 3), slice(3, 6)))
    table: Table = {
        "frame_index": np.array([f.frame_index for f in frames], dtype=np.int64),
        "stamp_ns": np.array([f.stamp_ns for f in frames], dtype=np.int64),
    }
    table |= {f"{axis}_m": pose[:, i, 3] for i, axis in enumerate("xyz")}
    table |= {f"q{axis}": quaternion[:, i] for i, axis in enumerate("xyzw")}
    table |= {f"sigma_{axis}_m": std_m[:, i] for i, axis in enumerate("xyz")}
    table |= {f"sigma_r{axis}_rad": std_rad[:, i] for i, axis in enumerate("xyz")}
    table["sigma_m"] = np.sqrt((std_m**2).sum(axis=1))
    table["status"] = np.array([str(f.status) for f in frames], dtype=str)
    for name in ("tracked", "new", "used", "rejected"):
        table[f"points_{name}"] = np.array([f.counts.get(name, 0) for f in frames], dtype=np.int64)
    table["nis_per_dof"] = np.array([f.nis / f.nis_dof if f.nis_dof else np.nan for f in frames], dtype=float)
    return table


def _std_in_world(world_from_cam: Array, cov: Array) -> Array:
    """Return σ (n, 3) along the world's axes of covariances (n, 3, 3) in axes of the cameras (n, 4, 4)."""
    known = np.isfinite(cov).all(axis=(1, 2))
    turned = world_from_cam[known, :3, :3]
    variances = np.full((len(cov), 3), np.nan)
    variances[known] = np.einsum("nij,njk,nik->ni", turned, cov[known], turned)
    return np.sqrt(np.maximum(variances, 0.0))
