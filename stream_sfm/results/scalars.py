"""The numbers of /stream_sfm/scalars: what one plots over time."""

import numpy as np

from ..geometry import se3
from ..geometry.se3 import Array
from ..types import FrameEstimate, Status
from .schema import ScalarsRecord

_STATUSES = tuple(Status)
_DEGREES = 180 / np.pi


class Scalars:
    """Makes the record of each frame; speeds and the path's length need the frame before."""

    def __init__(self) -> None:
        self._previous: tuple[int, Array] | None = None
        self._path_length = 0.0

    def of(self, estimate: FrameEstimate, pose: Array, covariance: Array) -> ScalarsRecord:
        """The numbers of a frame whose pose (4, 4) in the fixed frame has ROS's covariance (6, 6)."""
        speed, turning_deg_s = self._speeds(estimate.stamp_ns, pose)
        variances = np.diag(covariance)
        with np.errstate(invalid="ignore"):
            sigma = np.sqrt(variances)
            sigma_position, sigma_rotation = np.sqrt([variances[:3].sum(), variances[3:].sum()])
        x, y, z = map(float, pose[:3, 3])
        return ScalarsRecord(
            x=x,
            y=y,
            z=z,
            sigma_x=float(sigma[0]),
            sigma_y=float(sigma[1]),
            sigma_z=float(sigma[2]),
            sigma_position=float(sigma_position),
            sigma_rotation_deg=float(sigma_rotation * _DEGREES),
            speed=speed,
            angular_speed_deg_s=turning_deg_s,
            path_length=self._path_length,
            **{
                f"points_{name}": int(estimate.counts.get(name, 0))
                for name in ("tracked", "new", "used", "rejected")
            },
            nis_per_dof=float(estimate.nis / estimate.nis_dof) if estimate.nis_dof else float("nan"),
            status=_STATUSES.index(estimate.status),
        )

    def _speeds(self, stamp_ns: int, pose: Array) -> tuple[float, float]:
        """Speed and angular speed since the previous frame, NaN in the first."""
        previous, self._previous = self._previous, (stamp_ns, pose)
        if previous is None:
            return float("nan"), float("nan")
        seconds = (stamp_ns - previous[0]) / 1e9
        distance = float(np.linalg.norm(pose[:3, 3] - previous[1][:3, 3]))
        turned = float(np.linalg.norm(se3.log_so3(previous[1][:3, :3].T @ pose[:3, :3])))
        self._path_length += distance
        if seconds <= 0:
            return float("nan"), float("nan")
        return distance / seconds, turned * _DEGREES / seconds
