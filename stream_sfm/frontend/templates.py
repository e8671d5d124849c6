"""Anchored templates: every point is aligned against the patch of its first frame, never against the last one.

A patch that is followed from frame to frame drifts towards zero motion under image noise, and no estimator repairs
that. The template's own noise moves the point once and for all, which harms nobody. The patches are warped by the
affine map that pose and depth predict and laid out as one mosaic, so that all points are aligned in one call of
Lucas-Kanade.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.pose import Array

_ROWS = 32  # patches above each other in the atlas


class TemplateAtlas:
    """Patches of all tracks by slot, and their alignment with an image.

    `radius_px` of the alignment window (2r+1 pixels wide); patches are stored half as large again, so that a warp
    finds its pixels.
    """

    def __init__(self, slots: int, radius_px: int) -> None:
        self.radius = radius_px
        self.reach = radius_px + 3  # window, plus its derivatives, plus the fraction of a pixel
        self.half = int(1.6 * self.reach)
        self.side = 2 * self.half + 1
        self.atlas = np.zeros((_ROWS * self.side, -(-slots // _ROWS) * self.side), np.uint8)
        self.window = (2 * radius_px + 1, 2 * radius_px + 1)

    def _corners(self, slots: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        return slots // _ROWS * self.side, slots % _ROWS * self.side

    def store(self, image: NDArray[np.uint8], points_px: NDArray[np.intp], slots: NDArray[np.intp]) -> Array:
        """Cut patches around whole pixels (n, 2); returns their gradient matrices H (n, 2, 2), grey²."""
        h, w = image.shape
        steps = np.arange(-self.half, self.half + 1)
        u, v = points_px[:, 0, None] + steps, points_px[:, 1, None] + steps
        patches = image[v.clip(0, h - 1)[:, :, None], u.clip(0, w - 1)[:, None, :]]
        for patch, x, y in zip(patches, *self._corners(slots), strict=True):
            self.atlas[y : y + self.side, x : x + self.side] = patch
        inner = slice(self.half - self.radius - 1, self.half + self.radius + 2)
        p = patches[:, inner, inner].astype(np.float32)
        slopes = np.stack([p[:, 1:-1, 2:] - p[:, 1:-1, :-2], p[:, 2:, 1:-1] - p[:, :-2, 1:-1]], axis=1)
        slopes = 0.5 * slopes.reshape(len(slots), 2, -1)
        return np.asarray(slopes @ np.swapaxes(slopes, 1, 2), np.float64)

    def fits(self, anchor_from_now: Array) -> NDArray[np.bool_]:
        """Whether warps (n, 2, 2) stay inside the stored patches and do not blow them up beyond recognition."""
        extent = np.abs(anchor_from_now).sum(axis=2).max(axis=1) * self.reach
        area = np.abs(np.linalg.det(anchor_from_now))
        return (extent < self.half) & (area > 0.2)

    def mosaics(self, slots: NDArray[np.intp], anchor_from_now: Array, shape: tuple[int, int]) -> list[tuple]:
        """Warped templates laid out in images of `shape` (h, w): (image, rows of the points, centres (k, 2))."""
        tile = 2 * self.reach + 1
        columns, rows = shape[1] // tile, shape[0] // tile
        steps = np.arange(-self.reach, self.reach + 1, dtype=np.float32)
        out = []
        for start in range(0, len(slots), columns * rows):
            chunk = np.arange(start, min(start + columns * rows, len(slots)))
            used_rows = -(-len(chunk) // columns)
            w = anchor_from_now[chunk].astype(np.float32)
            x0, y0 = self._corners(slots[chunk])
            # maps (k, tile, tile): where each pixel of a tile comes from in the atlas
            x = (x0 + self.half).astype(np.float32)[:, None, None] + w[:, 0, 0, None, None] * steps[None, None, :]
            x = x + w[:, 0, 1, None, None] * steps[None, :, None]
            y = (y0 + self.half).astype(np.float32)[:, None, None] + w[:, 1, 0, None, None] * steps[None, None, :]
            y = y + w[:, 1, 1, None, None] * steps[None, :, None]
            tiles = (
                cv2.remap(self.atlas, x.reshape(-1, tile), y.reshape(-1, tile), cv2.INTER_LINEAR)
                if len(chunk) * tile < 32000
                else np.concatenate(
                    [cv2.remap(self.atlas, a, b, cv2.INTER_LINEAR) for a, b in zip(x, y, strict=True)]
                )
            )
            grid = np.zeros((used_rows * columns, tile, tile), np.uint8)
            grid[: len(chunk)] = tiles.reshape(-1, tile, tile)
            image = np.zeros(shape, np.uint8)
            image[: used_rows * tile, : columns * tile] = (
                grid.reshape(used_rows, columns, tile, tile)
                .swapaxes(1, 2)
                .reshape(used_rows * tile, columns * tile)
            )
            at = np.arange(len(chunk))
            centres = np.stack([at % columns, at // columns], axis=1) * tile + self.reach
            out.append((image, chunk, centres.astype(np.float32)))
        return out

    def align(
        self, mosaics: list[tuple], image: NDArray[np.uint8], starts_px: Array
    ) -> tuple[Array, NDArray[np.bool_], Array]:
        """Positions (n, 2) of the templates in an image, whether each converged (n,), mean grey difference (n,)."""
        n = len(starts_px)
        at, ok, error = np.array(starts_px, dtype=float), np.zeros(n, bool), np.full(n, np.inf)
        for mosaic, rows, centres in mosaics:
            start = np.ascontiguousarray(starts_px[rows], np.float32)
            found, status, difference = cv2.calcOpticalFlowPyrLK(
                mosaic,
                image,
                centres.reshape(-1, 1, 2),
                start.reshape(-1, 1, 2),
                winSize=self.window,
                maxLevel=0,
                criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.005),
                flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
                minEigThreshold=1e-5,
            )
            good = status[:, 0] > 0  # the rest of what comes back is not initialised
            at[rows[good]], error[rows[good]] = found[good, 0], difference[good, 0]
            ok[rows] = good & np.isfinite(at[rows]).all(axis=1)
        return at, ok, error
