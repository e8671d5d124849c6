"""New corners where points are missing: even coverage before strength."""

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.pose import Array

_DIM_SHARE = 0.02  # of the image's strongest corner: what always counts as one


def detect(
    image: NDArray[np.uint8],
    taken_px: Array,
    allowed: NDArray[np.bool_],
    wanted: int,
    distance_px: float,
    min_response: float,
) -> NDArray[np.intp]:
    """Up to `wanted` corners (k, 2) as integer pixels (u, v), `distance_px` from each other and from `taken_px` (m, 2).

    Strength is the smaller eigenvalue of the gradient matrix (Shi and Tomasi 1994). The image is cut into cells of
    about one wanted point each; a cell's corners are ranked, and all first ranks come before all second ranks.
    `allowed` (h, w) bool; `min_response` as `cv2.cornerMinEigenVal` gives it, less in images without contrast.
    """
    if wanted <= 0:
        return np.empty((0, 2), np.intp)
    height, width = image.shape
    response = cv2.cornerMinEigenVal(image, 5, ksize=3)
    radius = round(distance_px)
    # a dark image has all its contrast, and all its corners, scaled down
    min_response = min(min_response, _DIM_SHARE * float(response.max()))
    near = 2 * (radius // 3) + 1
    peak = response >= cv2.dilate(response, np.ones((near, near), np.uint8))
    free = allowed.astype(np.uint8)
    for u, v in np.rint(taken_px).astype(int).tolist():
        cv2.circle(free, (u, v), radius, 0, -1)
    found = cv2.findNonZero((peak & (response > min_response)).view(np.uint8) & free)
    if found is None:
        return np.empty((0, 2), np.intp)
    u, v = found.reshape(-1, 2).T
    strength = response[v, u]
    cell = max(2 * distance_px, np.sqrt(width * height / max(1, wanted + len(taken_px))))
    columns = int(width // cell) + 1
    cell_of = (v // cell).astype(int) * columns + (u // cell).astype(int)
    occupied = np.bincount(
        (taken_px[:, 1] // cell).astype(int).clip(0) * columns + (taken_px[:, 0] // cell).astype(int).clip(0),
        minlength=int(cell_of.max()) + 1,
    )
    order = np.lexsort((u, v, -strength, cell_of))
    first = np.searchsorted(cell_of[order], cell_of[order])
    rank = np.empty(len(order), int)
    rank[order] = np.arange(len(order)) - first
    rank += occupied[cell_of]
    order = np.lexsort((u, v, -strength, rank))
    chosen: list[int] = []
    for i in order[: 12 * wanted].tolist():
        if free[v[i], u[i]]:
            chosen.append(i)
            if len(chosen) == wanted:
                break
            cv2.circle(free, (int(u[i]), int(v[i])), radius, 0, -1)
    return np.stack([u[chosen], v[chosen]], axis=1)
