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
    rules, project = setup.rules.of(ImageRules), setup.projection.project_homogeneous
    result = np.abs(setup.raw_shifts_px(project(points))[:, 0]) < rules.overlay_px
    far_px = setup.raw_shifts_px(project(points[result] * (1, 1, 1, 0)))[:, 0]
    result[result] = np.abs(far_px) > 6 * rules.overlay_px
    return np.asarray(result)


def overlays(setup: Setup, tracks: Tracks, left_px: Array) -> NDArray[np.bool_]:
    """Return which tracks (n), which are at `left_px` (n, 2) now, are on such a picture, while most others move."""
    none = np.zeros(len(tracks), bool)
    moves = np.linalg.norm(left_px - tracks.left_px, axis=1) > setup.rules.of(ImageRules).overlay_px
    if min(np.count_nonzero(moves), np.count_nonzero(~moves)) < MANY_VIEWS:
        return none
    laid_over = are_laid_over(setup, tracks.points)
    on_picture, others = laid_over & ~moves, ~laid_over
    most_move = np.count_nonzero(moves & others) >= max(MANY_VIEWS, 0.5 * np.count_nonzero(others))
    return on_picture if most_move and np.count_nonzero(on_picture) >= MANY_VIEWS else none
