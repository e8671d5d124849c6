"""The views of a frame: anchored templates, found where a rough motion puts them."""

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry import Array
from ..record import record
from .alignment import WIDE
from .prepared import PreparedImages
from .rough_motion import RoughMotion
from .state import FrontEndState, Setup

_RIGHT = np.array([False, False, True, True])


@record
class AlignedViews:
    """Views of tracks that were found in a frame (k), at least on the left.

    Their `rows` in the table (n) of tracks, of which some should be `in_view` (n,); their `points` (k, 4) where the
    rough motion puts them; `z_px` (k, 4), NaN where the right side was not found; `cov_px` (k, 4, 4). `any_row_px`
    (k, 4): the same, including right sides that miss their row. `taken_px` (k, 4): what has been taken out of all these
    for the timing. `exposures` (k, 2): gains and offsets of the left image over the templates.
    """

    rows: NDArray[np.int64]
    in_view: NDArray[np.bool_]
    points: Array
    z_px: Array
    cov_px: Array
    any_row_px: Array
    taken_px: Array
    exposures: Array


def align(
    setup: Setup, state: FrontEndState, images: PreparedImages, rough: RoughMotion, twist: Array
) -> AlignedViews:
    """Find the tracks (n) in the new images, near where a rough motion puts them: the views of those found.

    `twist` (6,): how the points move in the camera, per second.
    """
    tracks, aligners, in_both = state.tracks, state.aligners, not setup.projection.virtual_right
    has_wide = WIDE in aligners and (tracks.scale == WIDE).any()
    in_view, rows, points, z_px, cov_px, any_row_px, taken_px, exposures = core.align_tracks(
        state.right_sides(twist),
        state.timing,
        tracks,
        tracks.slots,
        rough.cam_from_previous,
        rough.cam_from_previous @ state.cam_from_start,
        rough.left_px,  # what flow lost, the motion may find
        rough.agree,
        aligners[1].in_images(images, in_both),
        aligners[WIDE].in_images(images, in_both) if has_wide else None,
    )
    if setup.right_area is not None:
        z_px, any_row_px = (
            np.where(_RIGHT & setup.unseen_in_right(px)[:, None], np.nan, px) for px in (z_px, any_row_px)
        )
    return AlignedViews(rows, in_view, points, z_px, cov_px, any_row_px, taken_px, exposures)
