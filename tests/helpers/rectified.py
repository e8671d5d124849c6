"""The raw rows of the cameras of a rectified pair, and points in front of it."""

import numpy as np

from stream_sfm.camera.over_image import ExposedRows
from stream_sfm.geometry.se3 import Array
from stream_sfm.geometry.stereo import StereoProjection


def own_rows(projection: StereoProjection) -> ExposedRows:
    """Rows of images that are those of the rectified pair: (v + ½)/h − ½ of v = h (y + 1)/2."""
    coefficients = np.array([[[0.5 / projection.height, 0.5], [0.0, 0.0]]])
    return ExposedRows((projection.width, projection.height), coefficients)


def scattered_points(rng: np.random.Generator, n: int) -> Array:
    """Homogeneous points (n, 4) of slopes up to 0.5 across and 0.4 down, 2 to 20 m away."""
    rays = np.stack([rng.uniform(-0.5, 0.5, n), rng.uniform(-0.4, 0.4, n), np.ones(n)], axis=1)
    return np.concatenate([rays, 1 / rng.uniform(2, 20, (n, 1))], axis=1)
