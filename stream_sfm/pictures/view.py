"""What the checks keep of a frame."""

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry import Array
from ..record import record
from .prepared import Image


@record
class View:
    """The left image (h, w) of a frame, and the positions `left_px` (n, 2) of its tracks `ids` (n,), which ascend."""

    image: Image
    ids: NDArray[np.int64]
    left_px: Array

    def of(self, ids: NDArray[np.int64]) -> Array:
        """Return the positions (n, 2) of the given tracks; NaN for those that are not in it."""
        if not len(self.ids):
            return np.full((len(ids), 2), np.nan)
        rows = np.minimum(self.ids.searchsorted(ids), len(self.ids) - 1)
        px = self.left_px.take(rows, axis=0)
        px[self.ids.take(rows) != ids] = np.nan
        return px

    def inside(self, px: Array) -> NDArray[np.bool_]:
        """Return at which positions (n, 2) a patch, with all pixels that its sampling needs, lies within the image."""
        (x, y), (height, width), margin = px.T, self.image.shape, core.PATCH_RADIUS_PX + 3
        return np.asarray((x > margin - 1) & (x < width - margin) & (y > margin - 1) & (y < height - margin))
