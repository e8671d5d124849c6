"""Depths and rows by the right image: what each view of a track adds to its depth, and new matches to the rows."""

from dataclasses import replace
from typing import NamedTuple

from .. import core
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from ..rig_model.velocities import velocities
from .rows import Rows
from .tracks import Tracks

# Growth of the variance of inverse depth per frame: a tenth each time forgets depths that a wrong motion has carried
# along. Chosen by hand: with less, recovery is slower; with more, earlier views are wasted.
FORGETTING = 1.1


class RowMatches(NamedTuple):
    """New matches at `left_px` (n, 2), whose rows differ by `difference_px` (n,), of homogeneous `points` (n, 4)."""

    left_px: Array
    difference_px: Array
    points: Array


def learn_rows(rows: Rows, matches: RowMatches, twist: Array) -> Rows:
    """Return what is known of rows after the matches of a frame whose points move with a twist (6,)."""
    speed = velocities(rows.projection, matches.points, twist)[:, 3]
    return rows.learnt(matches.left_px, matches.difference_px, speed)


def update_depths(
    p: StereoProjection, tracks: Tracks, cam_from_previous: Array, z_px: Array, cov_px: Array
) -> Tracks:
    """Tracks (n) moved by (4, 4) onto the rays of views (n, 4) with covariances (n, 4, 4); not yet their `left_px`.

    1/Z by a scalar Kalman update where the right side is seen.
    """
    points, var_rho, cov_left_px = core.update_depths(
        p.pinholes, tracks.of_core, cam_from_previous, z_px, cov_px, FORGETTING
    )
    return replace(tracks, cov_left_px=cov_left_px, points=points, var_rho=var_rho)
