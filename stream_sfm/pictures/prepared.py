"""The rectified images of one frame in all forms that the front-end needs."""

from copy import copy
from functools import cached_property
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from .. import core
from ..record import record
from .rules import FlowRules

Image = NDArray[np.uint8]
GreyImage = NDArray[np.uint8] | NDArray[np.float32]
_RULES = FlowRules()


class Delivered(NamedTuple):
    """Parts of both images as the cameras have delivered them: some rows of each, and some columns of the left one."""

    left_rows: Image
    right_rows: Image
    left_columns: Image

    @classmethod
    def of(cls, left: Image, right: Image, every_row: int) -> "Delivered | None":
        """Copy these parts of a pair; None if the sizes differ."""
        if left.shape != right.shape:
            return None
        rows = slice(every_row // 2, None, every_row)
        return cls(left[rows].copy(), right[rows].copy(), outer_columns(left))


def outer_columns(image: Image) -> Image:
    """Return every second column of the outer quarters, which a motion straight ahead moves most."""
    quarter = image.shape[1] // 4
    return np.concatenate([image[:, :quarter:2], image[:, -quarter::2]], axis=1)


@record
class PreparedImages:
    """The two smoothed images (h, w) of one frame, and the left one at half the size for flow.

    `rectified`: both before smoothing. `stamp_ns`: of the frame. `grey_bits`: the bits of 16-bit images that count as
    used, None for other images. `made_by`: equal if images were processed the same way. `delivered`:
    parts of both before rectification. Other forms are computed when first used.
    """

    left: Image
    right: Image
    left_half: Image
    rectified: tuple[Image, Image]
    stamp_ns: int | None = None
    grey_bits: int | None = None
    made_by: str = ""
    delivered: Delivered | None = None
    rules: FlowRules = _RULES

    @classmethod
    def of(cls, left: Image, right: Image, sigma_px: float, **others: Any) -> "PreparedImages":
        """Prepare rectified images: smooth them by a Gaussian of `sigma_px`; `others`: fields beside the images."""
        same, rectified = left is right, (left, right)
        left = _smoothed(left, sigma_px)
        right = left if same else _smoothed(right, sigma_px)
        return cls(left, right, _halved(left), rectified, **others)

    @cached_property
    def coarse(self) -> tuple[Image, Image]:
        """The left and right image with at most `rules.coarse_columns` columns."""
        left = self.left if self.scale == 1 else _coarse(self.left_half, 2 * self.scale)
        return left, _coarse(self.right, self.scale)

    @cached_property
    def corner_strength(self) -> NDArray[np.float32]:
        """The strength of corners at every pixel of the coarse left image."""
        return core.corner_strength(self.coarse[0])

    @cached_property
    def quarter_grey(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Both images at a quarter of the size, from the rectified ones without intermediate rounding.

        One pixel is the mean of about thirty, so that blotches of one grey value stand out from noise and rounding.
        """
        left, right = (cv2.pyrDown(cv2.pyrDown(image.astype(np.float32))) for image in self.rectified)
        return np.asarray(left, np.float32), np.asarray(right, np.float32)

    @cached_property
    def quarter_flow(self) -> Image:
        """The left image at a quarter of the size with increased local contrast, in bytes as flow needs it."""
        left = self.quarter_grey[0]
        local = left - cv2.GaussianBlur(left, (0, 0), self.rules.local_px)
        return np.asarray(np.rint(self.rules.contrast * local + 128).clip(0, 255), np.uint8)

    @cached_property
    def exposure(self) -> tuple[float, float]:
        """The mean and standard deviation of the left image's grey values."""
        mean, std = cv2.meanStdDev(np.ascontiguousarray(self.left_half[::4, ::4]))
        return float(mean[0, 0]), float(std[0, 0])

    def grey(self, scale: int) -> tuple[GreyImage, GreyImage]:
        """Return the left and right image for alignment, with `scale` image pixels per pixel: 1 or 4."""
        return (self.left, self.right) if scale == 1 else self.quarter_grey

    def shrunk(self) -> "PreparedImages":
        """Return the same without the large forms that only the newest frame needs."""
        kept = copy(self)  # with the forms that were computed, which `replace` leaves out
        for form in ("coarse", "corner_strength"):
            kept.__dict__.pop(form, None)
        kept.__dict__["delivered"] = None
        return kept

    @property
    def scale(self) -> float:
        """The size of the coarse images over that of the whole ones: 1, ½, ¼, …"""
        return 0.5 ** max(0, int(np.ceil(np.log2(self.left.shape[1] / self.rules.coarse_columns))))


def _smoothed(image: Image, sigma_px: float) -> Image:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.uint8) if sigma_px > 0 else image.copy()


def _coarse(image: Image, scale: float) -> Image:
    return image if scale == 1 else _coarse(_halved(image), 2 * scale)


def _halved(image: Image) -> Image:
    return np.asarray(cv2.pyrDown(image), np.uint8)
