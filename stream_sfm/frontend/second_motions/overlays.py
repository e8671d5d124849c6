"""Finds tracks on a picture that is laid over both images: a time stamp, a logo, another camera's picture.

Such a picture is in the same columns of both raw images, wherever the cameras look, and it stays where it is. Where
cameras are not exactly parallel it seems to have a depth, so far points agree with it, and the camera seems to rest.
"""

import numpy as np
from numpy.typing import NDArray

from ...geometry import Array
from ...geometry.resection import MANY_VIEWS
from ...pictures.rules import ImageRules
from ..state import Setup
from ..tracks import Tracks


def are_laid_over(setup: Setup, points: Array) -> NDArray[np.bool_]:
    """Return which points (n, 4) are in the same columns of both raw images, where points at infinity are not."""
    if setup.raw_shifts_px is None or not len(points):
        return np.zeros(len(points), bool)
    rules, at_infinity = setup.rules.of(ImageRules), points * (1, 1, 1, 0)
    shift_px, far_px = (
        setup.raw_shifts_px(setup.projection.project_homogeneous(p))[:, 0] for p in (points, at_infinity)
    )
    return np.asarray((np.abs(shift_px) < rules.overlay_px) & (np.abs(far_px) > 6 * rules.overlay_px))


def overlays(setup: Setup, tracks: Tracks, left_px: Array) -> NDArray[np.bool_]:
    """Return which tracks (n), which are at `left_px` (n, 2) now, are on such a picture, while most others move."""
    laid_over = are_laid_over(setup, tracks.points)
    moves = np.linalg.norm(left_px - tracks.left_px, axis=1) > setup.rules.of(ImageRules).overlay_px
    on_picture, others = laid_over & ~moves, ~laid_over
    most_move = np.count_nonzero(moves & others) >= max(MANY_VIEWS, 0.5 * np.count_nonzero(others))
    return on_picture if most_move and np.count_nonzero(on_picture) >= MANY_VIEWS else np.zeros(len(tracks), bool)
