"""From the axes of rectified images, in which everything is estimated, to those of the physical left camera."""

import numpy as np

from ..geometry.se3 import Array


class RectifiedAxes:
    """Turns rectified axes, of the camera and of the world, into those of the physical left camera.

    The world is the first left camera: T_cam = C⁻¹ T_rect C, and right perturbations turn with C⁻¹, eq. (7).
    `rotation` (3, 3): that of points.
    """

    def __init__(self, rect_from_cam: Array) -> None:
        self.rotation = np.ascontiguousarray(rect_from_cam.T)
        self._rect_from_cam = np.eye(4)
        self._rect_from_cam[:3, :3] = rect_from_cam
        self._rotation_6 = np.zeros((6, 6))
        self._rotation_6[:3, :3] = self._rotation_6[3:, 3:] = self.rotation

    def poses(self, world_from_cam: Array) -> Array:
        """Turn poses (…, 4, 4)."""
        return self._rect_from_cam.T @ world_from_cam @ self._rect_from_cam

    def cov_pose(self, cov: Array) -> Array:
        """Turn the covariance (6, 6) of a pose."""
        return self._rotation_6 @ cov @ self._rotation_6.T

    def by_pose(self, jacobian: Array) -> Array:
        """Turn perturbations (…, 6, m) of poses."""
        return self._rotation_6 @ jacobian

    def points(self, points: Array) -> Array:
        """Turn points (n, 3)."""
        return points @ self.rotation.T
