"""What is believed of the motion without images: constant velocity, growing doubt. And the robust start.

Used as the start of every frame's estimate, and as the estimate itself while lost.
"""

from collections.abc import Iterable

import numpy as np

from ..config import MotionConfig
from ..geometry import se3
from ..geometry.resection import Resection, resect
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection

_UNKNOWN_VELOCITY_S = 1.0  # an unknown velocity is what the assumed acceleration builds up in this time


class MotionPrior:
    """The last estimated pose, its covariance and the velocity that led to it. Frames come in order of time."""

    def __init__(self, config: MotionConfig) -> None:
        self._config = config
        self._pose = np.eye(4)
        self._cov = np.zeros((6, 6))
        self._stamp_ns: int | None = None
        self._velocity = np.zeros(6)  # ξ per second, in the camera's own axes
        self._velocity_known = False

    @property
    def started(self) -> bool:
        """Whether any frame has come."""
        return self._stamp_ns is not None

    def record(self, stamp_ns: int, world_from_cam: Array, cov_pose: Array) -> None:
        """A frame was estimated from images."""
        dt = self._seconds_since(stamp_ns)
        if dt > 0:
            self._velocity = se3.log(se3.inverse(self._pose) @ world_from_cam) / dt
            self._velocity_known = True
        self.restart(stamp_ns, world_from_cam, cov_pose)

    def restart(self, stamp_ns: int, world_from_cam: Array, cov_pose: Array) -> None:
        """A new map begins at this pose: what is known of the velocity stays as it is."""
        self._pose, self._cov, self._stamp_ns = world_from_cam, cov_pose, stamp_ns

    def predict(self, stamp_ns: int) -> tuple[Array, Array]:
        """Pose (4, 4) and covariance (6, 6) at a later time; before the first frame the world itself, exactly.

        T Exp(ξ Δt) with Σ' = Ad Σ Adᵀ + Q, eqs. (42) and (43); Q from the assumed acceleration, half a Δt² an axis.
        """
        dt = self._seconds_since(stamp_ns)
        step = se3.exp(self._velocity * dt)
        ad = se3.adjoint(se3.inverse(step))
        time = 0.5 * dt * dt if self._velocity_known else dt * (0.5 * dt + _UNKNOWN_VELOCITY_S)
        std = np.repeat(
            [
                self._config.std_acceleration_m_s2 * time,
                self._config.std_angular_acceleration_rad_s2 * time,
            ],
            3,
        )
        return se3.orthonormalise(self._pose @ step), ad @ self._cov @ ad.T + np.diag(std**2)

    def _seconds_since(self, stamp_ns: int) -> float:
        return 0.0 if self._stamp_ns is None else max(0, stamp_ns - self._stamp_ns) / 1e9


def robust_start(
    projection: StereoProjection,
    points_in_ref: Array,
    cov_points: Array,
    z_px: Array,
    cov_px: Array,
    cam_from_ref_starts: Iterable[Array],
    gate_probability: float,
    min_views: int,
) -> Resection | None:
    """The first resection with at least `min_views` accepted views and half of all; else the best; else None."""
    best: Resection | None = None
    for start in cam_from_ref_starts:
        found = resect(projection, points_in_ref, cov_points, z_px, cov_px, start, gate_probability)
        count = int(found.accepted.sum())
        if found.ok and count >= min_views and (best is None or count > best.accepted.sum()):
            best = found
        if best is not None and 2 * best.accepted.sum() >= len(z_px):
            break
    return best
