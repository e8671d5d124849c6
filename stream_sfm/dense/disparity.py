"""Dense stereo: the disparity of every pixel of a rectified pair, with its σ.

The range of disparities is found on a small copy of the pair; semi-global matching with a left-right check
(Hirschmüller 2008, OpenCV) finds the disparity to the nearest pixel; `refine` adds the fraction and the σ, by
least-squares alignment of left and right in a window around each pixel.

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

from ..geometry import Array
from ..geometry.stereo import StereoProjection
from ..record import record
from .rules import DenseRules

Grey = NDArray[np.uint8]
Image = NDArray[np.float32]
_SLOPE_RADIUS_PX = 3  # half width of the patch in which the slope of the disparity is fitted
_MIN_GRADIENT = 1e-3  # grey²/px², keeps σ of a window without texture finite


@record
class DisparityMap:
    """Disparities of the pixels of the rectified left image, (h, w) float32, NaN where unknown.

    `disparity_px` > 0 is counted from infinity: Z = f B / disparity. `std_noise_px`: σ of the error from image noise,
    independent between frames; `std_bias_px`: σ of the error that all frames share (lens model, interpolation).
    """

    disparity_px: Image
    std_noise_px: Image
    std_bias_px: float

    @property
    def std_px(self) -> Image:
        """σ (h, w) of the disparity of a single frame, from noise and bias."""
        return np.hypot(self.std_noise_px, np.float32(self.std_bias_px))


class DenseStereo:
    """Computes disparity maps for one rectified pair; `valid` (h, w): the pixels with image content."""

    def __init__(self, projection: StereoProjection, rules: DenseRules, valid: NDArray[np.bool_]) -> None:
        self.projection, self.rules, self.valid = projection, rules, valid
        self._infinity_px = projection.cx_left_px - projection.cx_right_px

    def match(self, left: Grey, right: Grey) -> DisparityMap:
        """Match two rectified images (h, w)."""
        rules = self.rules
        start = self._matched(left, right, *self._range(left, right))
        disparity, std_noise = refine(left, right, start, rules)
        disparity -= np.float32(self._infinity_px)
        found = DisparityMap(disparity, std_noise, rules.std_bias_px)
        std = found.std_px
        with np.errstate(invalid="ignore"):
            known = self.valid & (std < rules.max_std_px) & (std < rules.max_relative_std * disparity)
        disparity[~known] = std_noise[~known] = np.nan
        return found

    def _range(self, left: Grey, right: Grey) -> tuple[int, int]:
        """Return the smallest and the largest disparity, in pixels of the images, found on a reduced copy of them."""
        first = self._infinity_px - 1
        last = self._infinity_px + self.rules.max_disparity_fraction * self.projection.width
        scale = 1
        while left.shape[1] > self.rules.search_width_px * 1.5:
            left, right, scale = cv2.pyrDown(left), cv2.pyrDown(right), 2 * scale  # type: ignore[assignment]
        if scale > 1:
            found = self._matched(left, right, int(np.floor(first / scale)) - 1, int(np.ceil(last / scale)))
            found = found[np.isfinite(found)]
            if len(found):
                low, high = np.percentile(found, (0.1, 99.9))  # disparities outside are mismatches
                first, last = max(first, scale * (low - 2)), min(last, scale * (high + 2))
        return int(np.floor(first)), int(np.ceil(last))

    def _matched(self, left: Grey, right: Grey, first: int, last: int) -> Image:
        """Return disparities (h, w) between `first` and `last`, in steps of 1/16 px; NaN where none was found."""
        block = self.rules.block_px
        count = 16 * -(-(last - first + 1) // 16)  # OpenCV requires a multiple of 16
        matcher = cv2.StereoSGBM.create(
            minDisparity=first,
            numDisparities=count,
            blockSize=block,
            P1=8 * block * block,  # both as OpenCV recommends
            P2=32 * block * block,
            disp12MaxDiff=1,  # largest disagreement of left and right, whole pixels
            uniquenessRatio=self.rules.uniqueness_percent,
            speckleWindowSize=100,  # smaller patches of disparity are mismatches; OpenCV recommends 50 to 200
            speckleRange=2,
            mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
        )
        # OpenCV skips all columns for which some disparity of the range points outside, so add a margin
        before, after = max(first + count, 0), max(-first, 0)
        wide = [cv2.copyMakeBorder(i, 0, 0, before, after, cv2.BORDER_CONSTANT) for i in (left, right)]
        width = left.shape[1]
        raw = matcher.compute(*wide)[:, before : before + width]
        disparity = raw.astype(np.float32) / cv2.StereoMatcher_DISP_SCALE
        in_right = np.arange(width, dtype=np.float32) - disparity
        disparity[(raw < cv2.StereoMatcher_DISP_SCALE * first) | (in_right < 0) | (in_right > width - 1)] = np.nan
        return np.asarray(disparity, np.float32)


def refine(left: Grey, right: Grey, start_px: Image, rules: DenseRules) -> tuple[Image, Image]:
    """Refine disparities (h, w), px; returns them with the σ of their noise, NaN where the start is NaN."""
    known = np.isfinite(start_px)
    if not known.any():
        return start_px, np.full_like(start_px, np.nan)
    size, own_px = 2 * rules.window_radius_px + 1, rules.own_px
    smoothing = rules.smoothing_px
    shared_pixels = max(1.0, 4 * np.pi * smoothing**2)  # smoothing correlates the noise over these
    soft_left, soft_right = (_smoothed(image, smoothing) for image in (left, right))
    slope_left, slope_right = (  # along the row, grey levels per pixel
        np.asarray(cv2.Sobel(image, cv2.CV_32F, 1, 0, scale=1 / 8), np.float32) for image in (soft_left, soft_right)
    )
    v, u = np.mgrid[: left.shape[0], : left.shape[1]].astype(np.float32)
    surface_px = rules.max_disparity_step_px  # larger differences separate surfaces
    # Far below all disparities: the bilateral filter must not average unknown pixels in.
    unknown = np.float32(np.nanmin(start_px) - 10 * surface_px)

    def total(values: NDArray[Any], size: int = size) -> Image:
        masked = np.where(known, values, 0).astype(np.float32)
        return np.asarray(cv2.boxFilter(masked, -1, (size, size), normalize=False), np.float32)

    n = np.maximum(total(known), 1)
    disparity = np.where(known, start_px, unknown)
    for _ in range(2):  # the start is within a pixel, and each step corrects most of what is left
        disparity = cv2.bilateralFilter(disparity, size, surface_px, rules.window_radius_px)
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
        noise = shared_pixels * np.maximum((rr - gr**2 / gg) / np.maximum(n - 2, 1), rules.least_noise_grey**2)
        disparity = disparity - gr / (gg + noise / rules.std_start_px**2)
    own = total(g * g, own_px) - total(g, own_px) ** 2 / np.maximum(total(known, own_px), 1)
    own = np.maximum(own, _MIN_GRADIENT)
    step_down = disparity - cv2.erode(disparity, np.ones((3, 3), np.uint8)) > rules.max_disparity_step_px
    near_step = cv2.dilate(step_down.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    std = np.sqrt(noise / np.where(near_step, own, gg))
    return np.where(known, disparity, np.float32(np.nan)), np.where(known, std, np.float32(np.nan))


def _smoothed(image: Grey, sigma_px: float) -> Image:
    grey = image.astype(np.float32)
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), sigma_px), np.float32) if sigma_px > 0 else grey


def rays(projection: StereoProjection) -> Array:
    """Return rays (h, w, 3) with Z = 1 through the pixels of the rectified left image."""
    v, u = np.mgrid[: projection.height, : projection.width]
    x, y = (u - projection.cx_left_px) / projection.f_px, (v - projection.cy_px) / projection.f_px
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def std_along_ray(
    projection: StereoProjection, ray: Array, disparity_px: NDArray[np.floating], std_px: NDArray[np.floating]
) -> Array:
    """Return σ (…) in metres, along rays (…, 3) with Z = 1, of points with given disparities (…) and their σ (…).

    The point is X = ray · f B / d; hence |∂X/∂d| = |ray| f B / d² = |ray| Z² / (f B).
    """
    fb = projection.f_px * projection.baseline_m
    return np.linalg.norm(ray, axis=-1) * fb / np.square(disparity_px, dtype=float) * std_px


def cosine_of_incidence(projection: StereoProjection, ray: Array, disparity_px: Image) -> Array:
    """Return the cosine (h, w) of the angle between viewing ray and surface normal; of a frontal plane where unknown.

    Where the disparity is d = a u + b v + …, the surface is a plane with n ∝ (f a, f b, d − a (u − cx) − b (v − cy))
    and n · ray ∝ d in the same unit.
    """
    offset = np.arange(-_SLOPE_RADIUS_PX, _SLOPE_RADIUS_PX + 1, dtype=np.float64)
    slope, mean = offset / (offset**2).sum(), np.full(len(offset), 1 / len(offset))
    f = projection.f_px
    across, down = (cv2.sepFilter2D(disparity_px, cv2.CV_64F, *k) for k in ((slope, mean), (mean, slope)))
    across, down = (np.where(np.isfinite(s), f * s, 0.0) for s in (across, down))
    length = np.linalg.norm(ray, axis=-1)
    facing = disparity_px - across * ray[..., 0] - down * ray[..., 1]
    return disparity_px / (length * np.sqrt(across**2 + down**2 + facing**2))
