"""The pose at the end of a run, with its uncertainty."""

from typing import Any

import numpy as np

from ..types import Trajectory
from .trajectory import path_length_m


def end_pose(trajectory: Trajectory) -> dict[str, Any] | None:
    """Return the last position and heading with their σ; None where there is no frame.

    The heading is the direction of the optical axis in the plane of the first camera's x and z, from z towards x.
    """
    if not len(trajectory) or trajectory.cov_pose is None:
        return None
    pose, cov = trajectory.world_from_cam[-1], trajectory.cov_pose[-1]
    length_m = path_length_m(trajectory.world_from_cam)
    std_m = float(np.sqrt(np.trace(cov[:3, :3])))
    up = pose[:3, :3].T @ (0, 1, 0)  # the axis that a change of heading turns about, in the camera
    return {
        "position_m": pose[:3, 3].tolist(),
        "std_position_m": std_m,
        "std_position_percent": 100 * std_m / length_m if length_m > 0 else None,
        "heading_deg": float(np.degrees(np.arctan2(pose[0, 2], pose[2, 2]))),
        "std_heading_deg": float(np.degrees(np.sqrt(up @ cov[3:, 3:] @ up))),
    }
