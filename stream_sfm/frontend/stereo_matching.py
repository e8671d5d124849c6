"""Left-right search along the row: normalised correlation of all corners at once, with a uniqueness test."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ..geometry.se3 import Array

# Half width of the correlation window, px: half of the default patch, as large where the images are of half the
# size.
_HALF = 5
# Between its samples; smoothing leaves neighbours the same noise. As many matches as with all, in a third of the
# time.
_SPACING_PX = 2
# Of the correlation, chosen by hand: higher values refuse blurred or slanted patches, lower ones let wrong
# matches in, most of which alignment and the check of halves refuse.
_MIN_CORRELATION = 0.75
_MIN_LEAD = 0.06  # over the best rival elsewhere on the row
_NEIGHBOURS_PX = 2  # of the best match, which are no rivals
_MIN_VARIANCE = 1e-3  # grey², keeps the correlation with a patch of one grey finite


def match_along_rows(
    left: NDArray[np.uint8] | NDArray[np.float32],
    right: NDArray[np.uint8] | NDArray[np.float32],
    points_px: NDArray[np.intp],
    disparity_range: tuple[int, int],
) -> tuple[Array, NDArray[np.bool_]]:
    """Whole-pixel disparities (n,) of pixels `points_px` (n, 2) of the left image, and where they are unique matches.

    Images of one pyramid level (h, w); disparities from `disparity_range` (first, last), pixels of that level.
    """
    n = len(points_px)
    first, last = disparity_range
    height, width = left.shape
    u, v = points_px.T
    inside = (u >= _HALF) & (u < width - _HALF) & (v >= _HALF) & (v < height - _HALF)
    best, ok = np.zeros(n), np.zeros(n, bool)
    rows = np.flatnonzero(inside)
    if not len(rows):
        return best, ok
    u, v = u[rows], v[rows]
    around = np.arange(-_HALF, _HALF + 1, _SPACING_PX)
    patches = left[v[:, None, None] + around[:, None], u[:, None, None] + around].astype(np.float32)
    candidates = u[:, None] - np.arange(last, first - 1, -1)  # centre column in the right image, ascending
    columns = candidates[:, :1] - _HALF + np.arange(candidates.shape[1] + 2 * _HALF)
    strips = right[v[:, None, None] + around[:, None], columns.clip(0, width - 1)[:, None, :]].astype(np.float32)
    p = patches - patches.mean((1, 2), keepdims=True)
    p_norm = np.sqrt((p * p).sum((1, 2)))
    dot = np.einsum("nidj,nij->nd", _windows(strips), p, optimize=True)
    sums = _windows(strips.sum(axis=1)).sum(axis=2)
    squares = _windows((strips * strips).sum(axis=1)).sum(axis=2)
    variance = np.maximum(squares - sums * sums / len(around) ** 2, _MIN_VARIANCE)
    score = dot / (p_norm[:, None] * np.sqrt(variance) + 1e-6)
    score[(candidates < _HALF) | (candidates >= width - _HALF)] = -1
    k = score.argmax(1)
    top = score[np.arange(len(rows)), k]
    rival = np.where(np.abs(np.arange(score.shape[1]) - k[:, None]) <= _NEIGHBOURS_PX, -1, score).max(1)
    best[rows] = u - candidates[np.arange(len(rows)), k]
    ok[rows] = (top > _MIN_CORRELATION) & (top - rival > _MIN_LEAD)
    return best, ok


def _windows(strips: NDArray[np.float32]) -> NDArray[np.float32]:
    """The samples (…, D, k) around each of the D candidates on strips (…, D + 2 half)."""
    return sliding_window_view(strips, 2 * _HALF + 1, axis=-1)[..., ::_SPACING_PX]
