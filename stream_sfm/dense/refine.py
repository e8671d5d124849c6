"""Sub-pixel disparities and their σ, by least-squares alignment of left and right in a window around each pixel.

Semi-global matching prefers whole pixels; on a fronto-parallel wall this is a bias of 0.15 px. The images in the
window are aligned by one correction e on top of the disparities found so far, so that slanted surfaces keep their
slant: e = −Σ g r / (Σ g² + s/σ₀²), where r = left − warped right, both without their means (so that an offset of grey
levels between the cameras has no effect), g is the gradient along the row, s the noise of r, and σ₀ the accuracy of
the start. The σ is that of the least squares without the start, √(s/Σ g²) (Förstner and Gülch 1987).

An untextured background beside a textured object is matched as part of it, as far as the windows reach. Near a step
to the background, or to unknown pixels, the Σ g² of σ is therefore taken over the close surroundings of the pixel.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..config import DenseConfig

Image = NDArray[np.float32]
_MIN_NOISE_GREY = 1.0  # grey levels: rounding, which smoothing hides
_OWN_PX = 5  # edge of the window in which a pixel beside a depth edge must have texture
_MIN_GRADIENT = 1e-3  # grey²/px², keeps the σ of a window without texture finite


def refine(
    left: NDArray[np.uint8], right: NDArray[np.uint8], start_px: Image, config: DenseConfig
) -> tuple[Image, Image]:
    """Refine disparities (h, w), px; returns them with the σ of their noise, NaN where the start is NaN."""
    known = np.isfinite(start_px)
    if not known.any():
        return start_px, np.full_like(start_px, np.nan)
    size = 2 * config.window_radius_px + 1
    smoothing = config.smoothing_px
    shared_pixels = max(1.0, 4 * np.pi * smoothing**2)  # over which smoothing correlates the noise
    soft_left, soft_right = (_smoothed(image, smoothing) for image in (left, right))
    slope_left, slope_right = (_slope(image) for image in (soft_left, soft_right))
    v, u = np.mgrid[: left.shape[0], : left.shape[1]].astype(np.float32)
    surface_px = config.max_disparity_step_px  # disparities that differ by more belong to different surfaces
    # Far below all disparities: the bilateral filter must not average unknown pixels in.
    unknown = np.float32(np.nanmin(start_px) - 10 * surface_px)

    def total(values: NDArray[Any], size: int = size) -> Image:
        masked = np.where(known, values, 0).astype(np.float32)
        return np.asarray(cv2.boxFilter(masked, -1, (size, size), normalize=False), np.float32)

    n = np.maximum(total(known), 1)
    disparity = np.where(known, start_px, unknown)
    for _ in range(2):  # the start is within a pixel, and each step corrects most of what is left
        disparity = cv2.bilateralFilter(disparity, size, surface_px, config.window_radius_px)
        disparity = np.where(known, disparity, unknown)
        warped, slope = (
            cv2.remap(image, u - disparity, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for image in (soft_right, slope_right)
        )
        g, r = (slope + slope_left) / 2, soft_left - warped
        mean_g, mean_r = total(g) / n, total(r) / n
        gg = np.maximum(total(g * g) - n * mean_g**2, _MIN_GRADIENT)
        gr = total(g * r) - n * mean_g * mean_r
        rr = total(r * r) - n * mean_r**2
        noise = shared_pixels * np.maximum((rr - gr**2 / gg) / np.maximum(n - 2, 1), _MIN_NOISE_GREY**2)
        disparity = disparity - gr / (gg + noise / config.std_start_px**2)
    own = np.maximum(
        total(g * g, _OWN_PX) - total(g, _OWN_PX) ** 2 / np.maximum(total(known, _OWN_PX), 1), _MIN_GRADIENT
    )
    step_down = disparity - cv2.erode(disparity, np.ones((3, 3), np.uint8)) > config.max_disparity_step_px
    near_step = cv2.dilate(step_down.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    std = np.sqrt(noise / np.where(near_step, own, gg))
    return np.where(known, disparity, np.float32(np.nan)), np.where(known, std, np.float32(np.nan))


def _smoothed(image: NDArray[np.uint8], sigma_px: float) -> Image:
    grey = image.astype(np.float32)
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), sigma_px), np.float32) if sigma_px > 0 else grey


def _slope(image: Image) -> Image:
    """Return the gradient along the row, grey levels per pixel."""
    return np.asarray(cv2.Sobel(image, cv2.CV_32F, 1, 0, scale=1 / 8), np.float32)
