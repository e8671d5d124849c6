"""The numbers of /stream_sfm/scalars, to plot over time."""

import numpy as np

from ..geometry import se3
from ..geometry.se3 import Array
from ..motion import Odometry
from ..types import Status
from .schema import ScalarsRecord

_STATUSES = tuple(Status)
_DEGREES = 180 / np.pi
_NAN = float("nan")


class Scalars:
    """Makes the record of each frame; the path's length is summed up."""

    def __init__(self) -> None:
        self._path_length = 0.0

    def of(self, odometry: Odometry, pose: Array, covariance: Array) -> ScalarsRecord:
        """Return the numbers of a frame whose pose (4, 4) in the world has ROS's covariance (6, 6)."""
        estimate, moved, seconds = odometry.estimate, odometry.from_previous, odometry.seconds or _NAN
        distance = float(np.linalg.norm(moved[:3, 3]))
        self._path_length += distance
        x, y, z = map(float, pose[:3, 3])
        variances = np.diag(covariance)
        with np.errstate(invalid="ignore"):
            sigma_x, sigma_y, sigma_z = np.sqrt(variances[:3]).tolist()
            sigma_position, sigma_rotation = np.sqrt([variances[:3].sum(), variances[3:].sum()]).tolist()
        counts = estimate.counts
        return ScalarsRecord(
            x=x,
            y=y,
            z=z,
            sigma_x=sigma_x,
            sigma_y=sigma_y,
            sigma_z=sigma_z,
            sigma_position=sigma_position,
            sigma_rotation_deg=sigma_rotation * _DEGREES,
            speed=distance / seconds,
            angular_speed_deg_s=float(np.linalg.norm(se3.log_so3(moved[:3, :3]))) * _DEGREES / seconds,
            path_length=self._path_length,
            points_tracked=int(counts.get("tracked", 0)),
            points_new=int(counts.get("new", 0)),
            points_used=int(counts.get("used", 0)),
            points_rejected=int(counts.get("rejected", 0)),
            nis_per_dof=float(estimate.nis / estimate.nis_dof) if estimate.nis_dof else _NAN,
            status=_STATUSES.index(estimate.status),
        )
