"""The slant of a new point's surface, from the shear between its left and right patch.

On a plane the inverse depth is affine in the image, and so is the disparity: d + a·δu + b·δv around a corner. All
corners are aligned at once by Gauss-Newton on (d, a, b, row), inverse compositional (Baker and Matthews 2004), with
a Gaussian prior on the slopes, so that a patch without texture to tell stays facing the camera. A wrong slant
biases the disparity for as long as the point is followed: the walls of a corridor shift by a third of a pixel.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.se3 import Array

# Slopes are in px of disparity per px of image.
_PRIOR_SLOPE = 0.15  # σ of the prior, chosen by hand: on most surfaces disparity changes more slowly
_MAX_SLOPE = 0.5  # chosen by hand: a patch of 21 px spans 10 px of disparity then, more than one surface does
# χ² with two degrees of freedom at 0.999: a slope that the patches do not clearly show costs more in noise than
# it saves in bias.
_SIGNIFICANT = 13.8
_STEPS = 3  # Gauss-Newton; more change no figure of the logs with ground truth
_MAX_SHIFT_PX = 2.0  # between the aligned position and the given one: farther it is another match
_SPACING_PX = 2  # between samples: smoothing leaves neighbours the same noise
_FREE = 1e-6  # prior information about disparity and row, 1/px²: none, but the normal matrix stays regular
_RIDGE = 1e-9  # relative to its trace, for the same
_MIN_CONTRAST = 1.0  # grey², keeps the gain of a patch of one grey finite


@dataclass(frozen=True, slots=True)
class _Patches:
    """Left patches (n) of m samples at `offsets` (2, m) = (δu, δv): `grey` (n, m) of mean zero, and its derivatives
    `steepest` (n, m, 4) by disparity, both slopes and row."""

    grey: NDArray[np.float32]
    offsets: NDArray[np.float32]
    steepest: NDArray[np.float32]


def disparity_slopes(
    left: NDArray[np.float32],
    right: NDArray[np.float32],
    points_px: NDArray[np.intp],
    right_px: Array,
    radius_px: int,
    std_grey: float,
) -> Array:
    """Slopes (n, 2) = (∂d/∂u, ∂d/∂v) at whole left pixels (n, 2) whose right positions (n, 2) are nearly known.

    Zero where the patches do not clearly show one. `std_grey`: deviation of one grey difference, with the pixels that
    share one noise value counted in.
    """
    if not len(points_px):
        return np.empty((0, 2))
    patches = _cut(left, points_px, radius_px)
    parameters, cov = _align(patches, right, points_px, right_px, std_grey)
    slopes = parameters[:, 1:3]
    shift_px = points_px[:, 0] - parameters[:, 0] - right_px[:, 0]
    sane = (np.abs(slopes).max(axis=1) < _MAX_SLOPE) & (np.abs(shift_px) < _MAX_SHIFT_PX)
    information = np.linalg.inv(cov[:, 1:3, 1:3]) / std_grey**2
    significant = np.einsum("ni,nij,nj->n", slopes, information, slopes) > _SIGNIFICANT
    return np.where((sane & significant)[:, None], slopes, 0.0)


def _cut(image: NDArray[np.float32], points_px: NDArray[np.intp], radius_px: int) -> _Patches:
    """Patches around whole pixels (n, 2), with what their derivatives need."""
    n, inner = len(points_px), slice(1, -1, _SPACING_PX)
    before, after = slice(0, -2, _SPACING_PX), slice(2, None, _SPACING_PX)
    steps = np.arange(-radius_px - 1, radius_px + 2)
    u = (points_px[:, 0, None, None] + steps).clip(0, image.shape[1] - 1)
    v = (points_px[:, 1, None, None] + steps[:, None]).clip(0, image.shape[0] - 1)
    patch = image[v, u]
    grey = patch[:, inner, inner].reshape(n, -1)
    grey = grey - grey.mean(axis=1, keepdims=True)
    by_u = 0.5 * (patch[:, inner, after] - patch[:, inner, before]).reshape(n, -1)
    by_v = 0.5 * (patch[:, after, inner] - patch[:, before, inner]).reshape(n, -1)
    sampled = steps[inner].astype(np.float32)
    du, dv = np.tile(sampled, len(sampled)), np.repeat(sampled, len(sampled))
    return _Patches(grey, np.stack([du, dv]), np.stack([-by_u, -by_u * du, -by_u * dv, by_v], axis=2))


def _align(
    patches: _Patches, right: NDArray[np.float32], points_px: NDArray[np.intp], right_px: Array, std_grey: float
) -> tuple[Array, Array]:
    """Disparity, slopes and row (n, 4) that align the patches with the right image, and inverse normal matrices
    (n, 4, 4)."""
    (du, dv), by_parameter = patches.offsets, np.ascontiguousarray(np.swapaxes(patches.steepest, 1, 2))
    prior = std_grey**2 * np.array([_FREE, _PRIOR_SLOPE**-2, _PRIOR_SLOPE**-2, _FREE])
    h = (by_parameter @ patches.steepest).astype(np.float64) + np.diag(prior)
    h += _RIDGE * np.trace(h, axis1=1, axis2=2)[:, None, None] * np.eye(4)
    cov = np.asarray(np.linalg.inv(h), np.float64)
    p: Array = np.zeros((len(points_px), 4))
    p[:, 0] = points_px[:, 0] - right_px[:, 0]
    p[:, 3] = right_px[:, 1] - points_px[:, 1]
    by_pixel = np.stack([np.ones_like(du), du, dv])
    for _ in range(_STEPS):
        at_u = (points_px[:, :1] + du - p[:, :3] @ by_pixel).astype(np.float32)
        at_v = (points_px[:, 1:] + dv + p[:, 3:]).astype(np.float32)
        there = np.asarray(
            cv2.remap(right, at_u, at_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32
        )
        there -= there.mean(axis=1, keepdims=True)
        # of the left exposure to the right
        gain = (patches.grey * there).sum(axis=1) / ((there * there).sum(axis=1) + _MIN_CONTRAST)
        difference = patches.grey - gain[:, None] * there
        g = (by_parameter @ difference[..., None])[..., 0] - prior * p * (0, 1, 1, 0)
        p = p + (cov @ g[..., None])[..., 0]
    return p, cov
