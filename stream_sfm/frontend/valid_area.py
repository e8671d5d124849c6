"""Where in the left image a whole patch shows the scene."""

import cv2
import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry.se3 import Array


def valid_area(valid: NDArray[np.bool_], radius_px: int) -> NDArray[np.bool_]:
    """Pixels (h, w) around which a patch of 2 `radius_px` + 1 lies within the image and its `valid` pixels (h, w)."""
    r = radius_px
    inside = np.zeros_like(valid)
    inside[r:-r, r:-r] = True
    return cv2.erode(valid.astype(np.uint8), np.ones((2 * r + 1, 2 * r + 1))).astype(bool) & inside


def contains(area: NDArray[np.bool_], at_px: Array) -> NDArray[np.bool_]:
    """Whether each position (n, 2) lies in an area (h, w)."""
    return core.inside_area(area, at_px)
