"""Disparity bias: the error that all views of a point share, its σ by track id.

Left and right patch of one surface share an error with all other views of the point: perspective beyond the affine
warp, the lens model, and most of all a depth edge within the patch. How far apart the whole patch and its inner half
are matched shows how large it may be. It moves the point, not the motion, and no number of views averages it out.
"""

from dataclasses import field, replace

import numpy as np
from numpy.typing import NDArray

from ..geometry.se3 import Array
from ..record import record

# σ₀ of eq. (18), of a patch whose halves agree. Measured on two rendered logs: with it the median error of local
# structure is 0.5 and 1.6 times its σ, without it 2.6 and 2.8 times.
MIN_BIAS_PX = 0.04
_REMEMBERED = 20_000  # points remembered, the latest; one older than all of them is given `MIN_BIAS_PX`


@record
class DisparityBias:
    """What was learnt when points `ids` (n,), ascending, were begun: `stds_px` (n,); at least `least_px`."""

    ids: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    stds_px: Array = field(default_factory=lambda: np.empty(0))
    least_px: float = MIN_BIAS_PX

    def learnt(self, ids: NDArray[np.int64], apart_px: Array) -> "DisparityBias":
        """Return the same with new points (n,), whose whole patch and inner half were matched (n,) apart."""
        stds_px = np.concatenate([self.stds_px, np.hypot(self.least_px, apart_px)])[-_REMEMBERED:]
        return replace(self, ids=np.concatenate([self.ids, ids])[-_REMEMBERED:], stds_px=stds_px)

    def std_px(self, ids: NDArray[np.int64]) -> Array:
        """Return σ (n,) px of points (n,), living or ended."""
        if not len(self.ids):
            return np.full(len(ids), self.least_px)
        at = np.minimum(np.searchsorted(self.ids, ids), len(self.ids) - 1)
        return np.where(self.ids[at] == ids, self.stds_px[at], self.least_px)
