"""Projects points into the recorded image, and pixels to rays: the pinhole camera with its lens.

OpenCV's models and coefficient order: plumb_bob (k1 k2 p1 p2 k3), rational_polynomial (… k4 k5 k6), equidistant
(Kannala–Brandt, θ polynomial).
"""

import cv2
import numpy as np

from ..geometry import Array
from .models import Camera


def distortion(camera: Camera) -> tuple[bool, Array]:
    """Return whether the lens is a fisheye (even with all coefficients zero), and its coefficients for OpenCV."""
    return camera.distortion_model == "equidistant", np.array(camera.D if any(camera.D) else (0.0,) * 4)


def project_into_image(camera: Camera, points_in_cam: Array) -> Array:
    """Project points (n, 3), Z > 0, into the recorded image: pixels (n, 2)."""
    if not len(points_in_cam):
        return np.empty((0, 2))
    fisheye, d = distortion(camera)
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    points = np.asarray(points_in_cam, float)[:, None]
    return np.asarray(project(points, np.zeros(3), np.zeros(3), camera.K, d)[0], float).reshape(-1, 2)


def rays_of(camera: Camera, pixels: Array) -> Array:
    """Return the rays (n, 3), Z = 1, of pixels (n, 2); not finite where the lens model has no solution."""
    fisheye, d = distortion(camera)
    found: Array | None = (cv2.fisheye if fisheye else cv2).undistortPoints(pixels[:, None], camera.K, d)
    # OpenCV 5 returns None if the iteration fails
    rays = np.full((len(pixels), 2), np.nan) if found is None else found[:, 0]
    return np.concatenate([rays, np.ones((len(pixels), 1))], axis=1)
