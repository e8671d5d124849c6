"""Patches around tracks in images, and the statistics over all patches of a frame."""

import cv2
import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry import Array
from ..record import record
from .prepared import Image

RADIUS_PX = core.PATCH_RADIUS_PX


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
        (x, y), (height, width), margin = px.T, self.image.shape, RADIUS_PX + 3
        return np.asarray((x > margin - 1) & (x < width - margin) & (y > margin - 1) & (y < height - margin))


def share_of(sums: Array) -> tuple[float, float]:
    """Return a share and its significance in σ from the sums (5,) of a control."""
    p, s, pp, ps, ss = sums
    if s <= 0:
        return 0.0, 0.0
    share = p / s
    variance = pp - 2 * share * ps + share**2 * ss  # of p, from the scatter of the patches
    return float(share), float(p / np.sqrt(max(variance, 1e-6 * pp)))


def at_least(share: float, significance: float, sigmas: float) -> float:
    """Return the lower bound of a share, `sigmas` of its σ below it."""
    return share * (1 - sigmas / significance) if significance > 0 else share


def patches_of(image: Image, at_px: Array, radius_px: int) -> NDArray[np.float32]:
    """Return patches (..., d, d), d = 2 `radius_px` + 1, of an image around positions (..., 2)."""
    d = 2 * radius_px + 1
    offsets = np.arange(-radius_px, radius_px + 1, dtype=np.float32)
    x, y = at_px.reshape(-1, 2).astype(np.float32).T[:, :, None, None]
    across, down = np.empty((2, x.size, d, d), np.float32)
    across[:], down[:] = x + offsets, y + offsets[:, None]
    sampled = cv2.remap(image, across.reshape(-1, d), down.reshape(-1, d), cv2.INTER_LINEAR)
    return sampled.astype(np.float32).reshape(*at_px.shape[:-1], d, d)
