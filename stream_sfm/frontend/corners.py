"""New corners where points are missing: even coverage before strength."""

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.se3 import Array

_DIM_SHARE = 0.02  # of the image's strongest corner: what always counts as one


def corner_strength(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """The smaller eigenvalue of the gradient matrix (Shi and Tomasi 1994) at every pixel (h, w)."""
    return np.asarray(cv2.cornerMinEigenVal(image, 5, ksize=3), np.float32)


def detect(
    strength: NDArray[np.float32],
    taken_px: Array,
    allowed: NDArray[np.bool_],
    wanted: int,
    distance_px: float,
    min_strength: float,
) -> NDArray[np.intp]:
    """Up to `wanted` corners (k, 2) as integer pixels (u, v), `distance_px` from each other and from `taken_px` (m, 2).

    The image is cut into cells of about one wanted point each; a cell's corners are ranked, and all first ranks come
    before all second ranks. `strength` (h, w) of `corner_strength`, and its least value `min_strength`, which is less
    in images without contrast; `allowed` (h, w) bool.
    """
    if wanted <= 0:
        return np.empty((0, 2), np.intp)
    height, width = strength.shape
    radius = round(distance_px)
    # a dark image has all its contrast, and all its corners, scaled down
    min_strength = min(min_strength, _DIM_SHARE * float(strength.max()))
    near = 2 * (radius // 3) + 1
    peak = strength >= cv2.dilate(strength, np.ones((near, near), np.uint8))
    free = allowed.astype(np.uint8)
    for u, v in np.rint(taken_px).astype(int).tolist():
        cv2.circle(free, (u, v), radius, 0, -1)
    found = cv2.findNonZero((peak & (strength > min_strength)).view(np.uint8) & free)
    if found is None:
        return np.empty((0, 2), np.intp)
    u, v = found.reshape(-1, 2).T
    found_strength = strength[v, u]
    cell = max(2 * distance_px, np.sqrt(width * height / max(1, wanted + len(taken_px))))
    columns = int(width // cell) + 1
    cell_of = (v // cell).astype(int) * columns + (u // cell).astype(int)
    occupied = np.bincount(
        (taken_px[:, 1] // cell).astype(int).clip(0) * columns + (taken_px[:, 0] // cell).astype(int).clip(0),
        minlength=int(cell_of.max()) + 1,
    )
    order = np.lexsort((u, v, -found_strength, cell_of))
    first = np.searchsorted(cell_of[order], cell_of[order])
    rank = np.empty(len(order), int)
    rank[order] = np.arange(len(order)) - first
    rank += occupied[cell_of]
    order = np.lexsort((u, v, -found_strength, rank))
    chosen: list[int] = []
    for i in order[: 12 * wanted].tolist():
        if free[v[i], u[i]]:
            chosen.append(i)
            if len(chosen) == wanted:
                break
            cv2.circle(free, (int(u[i]), int(v[i])), radius, 0, -1)
    return np.stack([u[chosen], v[chosen]], axis=1)
