"""The views of a frame: anchored templates, found near where a rough motion puts them."""

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry import Array
from ..geometry.stereo import StereoProjection
from ..geometry.view_stages import RawViews, TimedViews
from ..pictures.prepared import PreparedImages
from ..record import changed, record
from ..rig_model.terms import by_turn
from .alignment import WIDE
from .rough_motion import RoughMotion
from .state import FrontEndState, Setup

_RIGHT = np.array([False, False, True, True])


@record
class AlignedViews:
    """Views of the tracks (k) that were found in a frame, at least on the left.

    `rows` (k,): their rows in the table (n) of tracks; `in_view` (n,): which tracks of the table should be in view;
    `points` (k, 4): where the rough motion puts them; `z_px` (k, 4), NaN if the right side was not found; `cov_px`
    (k, 4, 4). `any_row_px` (k, 4): views that include right sides off their row. `taken_px` (k, 4): the correction for
    delay and readout that has been subtracted from all of these. `exposures` (k, 2): gains and offsets of the left
    image over the templates; `contrast` (k,): of the patches in it.
    """

    rows: NDArray[np.int64]
    in_view: NDArray[np.bool_]
    points: Array
    z_px: TimedViews
    cov_px: Array
    any_row_px: TimedViews
    taken_px: Array
    exposures: Array
    contrast: Array

    def raw_px(self, rows: NDArray[np.int64]) -> RawViews:
        """Return some of the views as the images show them."""
        return RawViews(self.z_px.take(rows, axis=0) + self.taken_px.take(rows, axis=0))

    def with_off_row(self, rows: NDArray[np.bool_]) -> "AlignedViews":
        """Return the same, with those right sides of a mask (k,) of views that are off their rows."""
        return changed(self, z_px=TimedViews(np.where(rows[:, None], self.any_row_px, self.z_px)))


def turned_px(projection: StereoProjection, z_px: Array, rad: Array) -> Array:
    """Return the effects (n, 4) px of a turn (3,) of the right camera on views (n, 4)."""
    return by_turn(projection, z_px, rad[:, None])[..., 0] if rad.any() else np.zeros_like(z_px)


def align(setup: Setup, state: FrontEndState, images: PreparedImages, rough: RoughMotion, twist: Array) -> AlignedViews:
    """Find the tracks (n) in the new images, near where a rough motion puts them, and return the views of those found.

    `twist` (6,): the motion of the points in the camera, per second.
    """
    tracks, aligners, in_both = state.tracks, state.aligners, not setup.projection.virtual_right
    has_wide = WIDE in aligners and (tracks.scale == WIDE).any()
    in_view, rows, points, z_px, cov_px, any_row_px, taken_px, *grey = core.align_tracks(
        state.right_sides(twist),
        state.timing,
        tracks,
        tracks.slots,
        rough.cam_from_previous,
        rough.cam_from_previous @ state.cam_from_start,
        rough.left_px,  # the motion may recover tracks that flow has lost
        rough.agree,
        aligners[1].in_images(images, in_both),
        aligners[WIDE].in_images(images, in_both) if has_wide else None,
    )
    if setup.right_area is not None:
        z_px, any_row_px = (
            np.where(_RIGHT & setup.unseen_in_right(px)[:, None], np.nan, px) for px in (z_px, any_row_px)
        )
    z_px, any_row_px = (px + turned_px(setup.projection, px, state.unusual_rad) for px in (z_px, any_row_px))
    views = TimedViews(z_px), cov_px, TimedViews(any_row_px)
    return AlignedViews(rows, in_view, points, *views, taken_px, *grey)
