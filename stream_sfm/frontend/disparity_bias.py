"""What all views of a point have wrong together: σ of its disparity's bias, by track id.

Left and right patch of one surface share an error with all other views of the point: perspective beyond the affine
warp, the lens model, and most of all a depth edge within the patch. How far apart the whole patch and its inner half
are matched shows how large it may be. It moves the point, not the motion, and no number of views averages it out.
"""

import numpy as np
from numpy.typing import NDArray

from ..geometry.se3 import Array

BIAS_PX = 0.04  # of a patch whose halves agree
_KEPT = 10_000  # points, twice: the last ones born. A point that has outlived so many is given `BIAS_PX`.


class SharedErrors:
    """`of(ids)`: standard deviations (n,) px of what was learnt at birth, `least_px` where nothing was."""

    def __init__(self, least_px: float = BIAS_PX) -> None:
        self._least_px = least_px
        self._recent: dict[int, float] = {}
        self._older: dict[int, float] = {}

    def learn(self, ids: NDArray[np.int64], apart_px: Array) -> None:
        """New points (n,), and how far apart (n,) whole patch and inner half were matched."""
        if len(self._recent) > _KEPT:
            self._recent, self._older = {}, self._recent
        std_px = np.hypot(self._least_px, apart_px)
        self._recent.update(zip(ids.tolist(), std_px.tolist(), strict=True))

    def of(self, ids: NDArray[np.int64]) -> Array:
        """(n,) px of points (n,), living or ended."""
        recent, older, least = self._recent, self._older, self._least_px
        return np.array([recent.get(i) or older.get(i, least) for i in ids.tolist()], dtype=float)
