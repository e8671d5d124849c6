"""Where a point appears in the image as delivered: the pinhole camera with its lens distortion."""

import numpy as np

from ..geometry.se3 import Array
from .models import Camera

_ON_AXIS = 1e-12  # of x and y at depth 1: nearer to the axis a fisheye bends nothing


def project_into_image(camera: Camera, points_in_cam: Array) -> Array:
    """Project points (n, 3), Z > 0, into the image as delivered: pixels (n, 2).

    OpenCV's models and coefficient order: plumb_bob (k1 k2 p1 p2 k3), rational_polynomial (… k4 k5 k6),
    equidistant (Kannala–Brandt, θ polynomial).
    """
    x = points_in_cam[:, 0] / points_in_cam[:, 2]
    y = points_in_cam[:, 1] / points_in_cam[:, 2]
    d = camera.D
    if camera.distortion_model == "equidistant":  # a fisheye also where its coefficients are all zero
        d = d or (0.0,) * 4
        r = np.hypot(x, y)
        theta = np.arctan(r)
        bent = theta * (1 + theta**2 * (d[0] + theta**2 * (d[1] + theta**2 * (d[2] + theta**2 * d[3]))))
        factor = np.where(r > _ON_AXIS, bent / np.where(r > _ON_AXIS, r, 1.0), 1.0)
        x, y = x * factor, y * factor
    elif any(d):
        k1, k2, p1, p2, k3, k4, k5, k6 = (*d, *(0.0,) * (8 - len(d)))
        r2 = x * x + y * y
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        x, y = (
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        )
    k = camera.K
    return np.stack([k[0, 0] * x + k[0, 1] * y + k[0, 2], k[1, 1] * y + k[1, 2]], axis=1)
