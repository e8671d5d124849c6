"""The slant of a new point's surface, from the shear between its left and right patch.

On a plane the inverse depth is affine in the image, and so is the disparity: d + a·δu + b·δv around a corner. All
corners are aligned at once by Gauss-Newton on (d, a, b, row), inverse compositional (Baker and Matthews 2004), with
a Gaussian prior on the slopes, so that a patch without texture to tell stays facing the camera. A wrong slant
biases the disparity for as long as the point is followed: the walls of a corridor shift by a third of a pixel.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.se3 import Array

_PRIOR_SLOPE = 0.15  # px of disparity per px of image
_MAX_SLOPE = 0.5
# Χ²(2), 0.999: a slope that the patches do not clearly show costs more noise than it saves bias.
_SIGNIFICANT = 13.8
_ITERATIONS = 3


def disparity_slopes(
    left: NDArray[np.float32],
    right: NDArray[np.float32],
    points_px: NDArray[np.intp],
    right_px: Array,
    radius_px: int,
    std_grey: float,
) -> Array:
    """Slopes (n, 2) = (∂d/∂u, ∂d/∂v) at whole left pixels (n, 2) whose right positions (n, 2) are nearly known.

    `std_grey`: deviation of one grey difference, with the pixels that share one noise value counted in.
    """
    n = len(points_px)
    if not n:
        return np.empty((0, 2))
    steps = np.arange(-radius_px - 1, radius_px + 2)
    u = (points_px[:, 0, None, None] + steps).clip(0, left.shape[1] - 1)
    v = (points_px[:, 1, None, None] + steps[:, None]).clip(0, left.shape[0] - 1)
    patch = left[v, u]
    # every second pixel: neighbours share their noise, smoothing has seen to that
    template = patch[:, 1:-1:2, 1:-1:2].reshape(n, -1)
    template = template - template.mean(axis=1, keepdims=True)
    tu = 0.5 * (patch[:, 1:-1:2, 2::2] - patch[:, 1:-1:2, :-2:2]).reshape(n, -1)
    tv = 0.5 * (patch[:, 2::2, 1:-1:2] - patch[:, :-2:2, 1:-1:2]).reshape(n, -1)
    inner = steps[1:-1:2].astype(np.float32)
    du, dv = np.tile(inner, len(inner)), np.repeat(inner, len(inner))
    steepest = np.stack([-tu, -tu * du, -tu * dv, tv], axis=2)  # (n, pixels, 4): d, a, b, row
    transposed = np.ascontiguousarray(np.swapaxes(steepest, 1, 2))
    prior = std_grey**2 * np.array([1e-6, _PRIOR_SLOPE**-2, _PRIOR_SLOPE**-2, 1e-6])
    h = (transposed @ steepest).astype(np.float64) + np.diag(prior)
    h += 1e-9 * np.trace(h, axis1=1, axis2=2)[:, None, None] * np.eye(4)
    cov = np.linalg.inv(h)
    p = np.zeros((n, 4))
    p[:, 0] = points_px[:, 0] - right_px[:, 0]
    p[:, 3] = right_px[:, 1] - points_px[:, 1]
    by_pixel = np.stack([np.ones_like(du), du, dv])
    for _ in range(_ITERATIONS):
        at_u = (points_px[:, :1] + du - p[:, :3] @ by_pixel).astype(np.float32)
        at_v = (points_px[:, 1:] + dv + p[:, 3:]).astype(np.float32)
        there = cv2.remap(right, at_u, at_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        there = np.asarray(there, np.float32)
        there -= there.mean(axis=1, keepdims=True)
        gain = (template * there).sum(axis=1) / (
            (there * there).sum(axis=1) + 1.0
        )  # of the left exposure to the right
        difference = template - gain[:, None] * there
        g = (transposed @ difference[..., None])[..., 0] - prior * p * (0, 1, 1, 0)
        p = p + (cov @ g[..., None])[..., 0]
    slopes = p[:, 1:3]
    sane = (np.abs(slopes).max(axis=1) < _MAX_SLOPE) & (np.abs(points_px[:, 0] - p[:, 0] - right_px[:, 0]) < 2.0)
    info = np.linalg.inv(cov[:, 1:3, 1:3]) / std_grey**2
    told = np.einsum("ni,nij,nj->n", slopes, info, slopes) > _SIGNIFICANT
    return np.where((sane & told)[:, None], slopes, 0.0)
