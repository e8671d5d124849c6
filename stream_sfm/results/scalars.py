"""The numbers of /stream_sfm/scalars, to plot over time."""

import numpy as np

from ..geometry import se3
from ..geometry.se3 import Array
from ..types import FrameEstimate, Status
from .schema import ScalarsRecord

_STATUSES = tuple(Status)
_DEGREES = 180 / np.pi
_NAN = float("nan")


class Scalars:
    """Makes the record of each frame; speeds and the path's length need the previous frame."""

    def __init__(self) -> None:
        self._previous: tuple[int, Array] | None = None
        self._path_length = 0.0

    def of(self, estimate: FrameEstimate, pose: Array, covariance: Array) -> ScalarsRecord:
        """Return the numbers of a frame whose pose (4, 4) in the fixed frame has ROS's covariance (6, 6)."""
        speed, angular_speed_deg_s = self._speeds(estimate.stamp_ns, pose)
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
            speed=speed,
            angular_speed_deg_s=angular_speed_deg_s,
            path_length=self._path_length,
            points_tracked=int(counts.get("tracked", 0)),
            points_new=int(counts.get("new", 0)),
            points_used=int(counts.get("used", 0)),
            points_rejected=int(counts.get("rejected", 0)),
            nis_per_dof=float(estimate.nis / estimate.nis_dof) if estimate.nis_dof else _NAN,
            status=_STATUSES.index(estimate.status),
        )

    def _speeds(self, stamp_ns: int, pose: Array) -> tuple[float, float]:
        """Return the speed and angular speed since the previous frame, NaN in the first."""
        previous, self._previous = self._previous, (stamp_ns, pose)
        if previous is None:
            return _NAN, _NAN
        seconds = (stamp_ns - previous[0]) / 1e9
        distance = float(np.linalg.norm(pose[:3, 3] - previous[1][:3, 3]))
        turned = float(np.linalg.norm(se3.log_so3(previous[1][:3, :3].T @ pose[:3, :3])))
        self._path_length += distance
        return (distance / seconds, turned * _DEGREES / seconds) if seconds > 0 else (_NAN, _NAN)
