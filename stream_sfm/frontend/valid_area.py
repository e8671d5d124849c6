"""Where in the left image a whole patch shows the scene."""

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.se3 import Array


class ValidArea:
    """Pixels around which a patch of 2 `radius_px` + 1 lies within the image and within its `valid` pixels (h, w)."""

    def __init__(self, valid: NDArray[np.bool_], radius_px: int) -> None:
        r = radius_px
        inside = np.zeros_like(valid)
        inside[r:-r, r:-r] = True
        patch = np.ones((2 * r + 1, 2 * r + 1))
        self._mask = cv2.erode(valid.astype(np.uint8), patch).astype(bool) & inside

    def contains(self, at_px: Array) -> NDArray[np.bool_]:
        """Whether each position (n, 2) lies in the area."""
        h, w = self._mask.shape
        u, v = np.rint(at_px.clip(-1, max(h, w))).astype(int).T
        inside: NDArray[np.bool_] = (u >= 0) & (u < w) & (v >= 0) & (v < h)
        inside &= self._mask[v.clip(0, h - 1), u.clip(0, w - 1)]
        return inside

    def coarse(self, step_px: int) -> NDArray[np.bool_]:
        """The area as a mask of every `step_px`-th row and column."""
        return self._mask[::step_px, ::step_px]
