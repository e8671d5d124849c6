"""Optical flow: the approximate motion of the tracked points since the previous image.

It is pyramidal Lucas-Kanade between images at half the size, started where the predicted motion puts the points. Flow
gives initial values only: the position of a point comes from its anchored template (`alignment.py`).
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry import Array
from ..pictures.prepared import Image, PreparedImages
from ..pictures.rules import FlowRules
from .alignment import WIDE, TemplateAligner


def track(
    aligner: TemplateAligner,
    rules: FlowRules,
    before_half: Image,
    images: PreparedImages,
    left_px: Array,
    predicted_px: Array,
    levels: int,
    zoom: float = 1.0,
) -> tuple[Array, NDArray[np.bool_]]:
    """Return positions (n, 2) in the new left image, and which were found where a whole patch shows the scene.

    The search goes from `left_px` (n, 2) in the previous left image, which is given at half its size as `before_half`,
    and starts at `predicted_px` (n, 2). The pyramid has `levels` halvings of the image. `zoom` enlarges the previous
    image about its centre, for patches that have come closer.
    """
    radius_px = 3 * aligner.config.window_radius_px // 4  # in the half-size image, 1.5 times the patch
    before_half, left_half_px = _zoomed(before_half, left_px / 2, zoom)
    at_px, found = _lucas_kanade(
        rules, before_half, images.left_half, left_half_px, predicted_px, 2, radius_px, levels - 1
    )  # the lowest level is already halved once
    return at_px, found & core.inside_area(aligner.area, at_px)


def track_wide(
    aligner: TemplateAligner,
    rules: FlowRules,
    previous: PreparedImages,
    images: PreparedImages,
    left_px: Array,
    predicted_px: Array,
) -> tuple[Array, NDArray[np.bool_]]:
    """Do the same as `track` for wide templates, in images at a quarter of the size with raised contrast."""
    radius_px = aligner.config.window_radius_px
    before, now = previous.quarter_flow, images.quarter_flow
    at_px, found = _lucas_kanade(rules, before, now, left_px / WIDE, predicted_px, WIDE, radius_px, rules.wide_levels)
    return at_px, found & core.inside_area(aligner.area, at_px)


def _lucas_kanade(
    rules: FlowRules,
    before: Image,
    now: Image,
    before_px: Array,
    predicted_px: Array,
    scale: int,
    radius_px: int,
    levels: int,
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the new positions (n, 2) of points that were at `before_px` (n, 2), and which were found (n,).

    The images are `scale` times smaller than the originals, and `before_px` and the windows of 2 `radius_px` + 1 are in
    their pixels; `predicted_px` and the result are in pixels of the originals. The images are halved `levels` times.
    """
    start = np.ascontiguousarray(predicted_px, np.float32)
    at, status, _ = cv2.calcOpticalFlowPyrLK(
        before,
        now,
        np.ascontiguousarray(before_px, np.float32).reshape(-1, 1, 2),
        start.reshape(-1, 1, 2) / scale,
        winSize=(2 * radius_px + 1, 2 * radius_px + 1),
        maxLevel=levels,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, rules.max_steps, rules.converged_px),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        minEigThreshold=rules.min_eigenvalue,
    )
    found = status[:, 0] > 0  # other rows of the result are not initialised
    positions: Array = np.where(found[:, None], scale * np.asarray(at)[:, 0], start).astype(np.float64)
    return positions, found


def _zoomed(image: Image, at_px: Array, zoom: float) -> tuple[Image, Array]:
    """Return an image enlarged about its centre, and the positions (n, 2) in it."""
    if zoom == 1.0:
        return image, at_px
    height, width = image.shape
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    shift = middle * (1 - zoom)
    enlarge = np.array([[zoom, 0, shift[0]], [0, zoom, shift[1]]])
    return np.asarray(cv2.warpAffine(image, enlarge, (width, height)), np.uint8), zoom * at_px + shift


def as_exposed(before: PreparedImages, now: PreparedImages, rules: FlowRules) -> Image:
    """Return the previous left image at half size, adjusted to the new mean and contrast.

    Flow mistakes a change of grey values for motion.
    """
    (mean_before, std_before), (mean_now, std_now) = before.exposure, now.exposure
    gain = (std_now + 1) / (std_before + 1)
    if abs(gain - 1) < rules.same_gain and abs(mean_now - mean_before) < rules.same_level_grey:
        return before.left_half
    exposed = np.rint((np.arange(256) - mean_before) * gain + mean_now).clip(0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(before.left_half, exposed))
