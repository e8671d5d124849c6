"""New corners where points are missing: even coverage before strength."""

import cv2
import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry.se3 import Array

_BLOCK_PX = 5  # window of the gradient matrix, a usual small one; its derivatives have OpenCV's, 3
# Share of the strongest response in the image above which a pixel always counts as a corner, chosen by hand. An
# exposure cut to a quarter leaves none above a fixed limit.
_DIM_FRACTION = 0.02
_PEAK_FRACTION = 3  # one of so many of the distance: a corner is the strongest within it
_MIN_CELL = 2.0  # distances: a cell has room for one corner at least
_CANDIDATES = 12  # candidates per corner wanted: further ones are weaker and cost time


def corner_strength(image: NDArray[np.uint8] | NDArray[np.float32]) -> NDArray[np.float32]:
    """The smaller eigenvalue of the gradient matrix (Shi and Tomasi 1994) at every pixel (h, w)."""
    return np.asarray(cv2.cornerMinEigenVal(image, _BLOCK_PX), np.float32)


def detect(
    strength: NDArray[np.float32],
    taken_px: Array,
    allowed: NDArray[np.bool_],
    wanted: int,
    distance_px: float,
    min_strength: float,
) -> NDArray[np.intp]:
    """Find up to `wanted` corners (k, 2) in whole pixels, `distance_px` from each other and from `taken_px` (m, 2).

    The image is cut into cells of about one wanted point each; a cell's corners are ranked, and all first ranks come
    before all second ranks. `strength` (h, w) of `corner_strength`, and its least value `min_strength`, which is less
    in images without contrast; `allowed` (h, w) bool.
    """
    if wanted <= 0:
        return np.empty((0, 2), np.intp)
    free = _free(allowed, taken_px, round(distance_px))
    found = _peaks(strength, free, round(distance_px), min_strength)
    if not len(found):
        return found
    u, v = found.T
    cell_px = _cell_px(strength.shape, wanted + len(taken_px), distance_px)
    order = core.order_of_corners(found, strength[v, u], taken_px, cell_px, strength.shape[1])
    chosen: list[int] = []
    for i in order[: _CANDIDATES * wanted].tolist():
        if free[v[i], u[i]]:
            chosen.append(i)
            if len(chosen) == wanted:
                break
            cv2.circle(free, (int(u[i]), int(v[i])), round(distance_px), 0, -1)
    return found[chosen]


def _free(allowed: NDArray[np.bool_], taken_px: Array, radius_px: int) -> NDArray[np.uint8]:
    """Where a corner may be: 1 in `allowed` pixels that are not near those taken, else 0."""
    free = allowed.astype(np.uint8)
    for u, v in np.rint(taken_px).astype(int).tolist():
        cv2.circle(free, (u, v), radius_px, 0, -1)
    return free


def _peaks(
    strength: NDArray[np.float32], free: NDArray[np.uint8], radius_px: int, min_strength: float
) -> NDArray[np.intp]:
    """Pixels (k, 2) where the strength is the largest around and large enough."""
    # in a dark image all contrast, and with it every response, is scaled down
    min_strength = min(min_strength, _DIM_FRACTION * float(strength.max()))
    near = 2 * (radius_px // _PEAK_FRACTION) + 1
    peak = strength >= cv2.dilate(strength, np.ones((near, near), np.uint8))
    found = cv2.findNonZero((peak & (strength > min_strength)).view(np.uint8) & free)
    return np.empty((0, 2), np.intp) if found is None else np.asarray(found.reshape(-1, 2), np.intp)


def _cell_px(shape: tuple[int, ...], points: int, distance_px: float) -> float:
    """Edge of cells of about one point each."""
    return float(max(_MIN_CELL * distance_px, np.sqrt(shape[0] * shape[1] / max(1, points))))
