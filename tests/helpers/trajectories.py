"""The poses in an `estimates.mcap`."""

from pathlib import Path

import numpy as np

from stream_sfm.results.estimates_reader import read_estimates
from stream_sfm.types import Trajectory


def read_trajectory(path: str | Path) -> Trajectory:
    """Stamps, poses and covariances of all frames, exact to the last bit. Raises LogError behind what is damaged."""
    records = list(read_estimates(path))
    return Trajectory(
        np.array([r.stamp_ns for r in records], dtype=np.int64),
        np.array([r.world_from_cam for r in records], dtype=float).reshape(-1, 4, 4),
        np.array([r.cov_pose for r in records], dtype=float).reshape(-1, 6, 6),
    )
