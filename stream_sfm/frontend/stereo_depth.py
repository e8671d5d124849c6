"""Depths from the right image: every track is aligned in it, too, and its disparity measured in each frame."""

from typing import NamedTuple

import numpy as np

from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from ..rig_model.turns import effects_of_turn
from ..rig_model.velocities import principal, velocities
from .alignment import AlignedViews, Aligners, Candidates, LeftViews, TemplateAligner, split
from .prepared import PreparedImages
from .right_turn import RightTurn
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


def learn_rows(rows: Rows, matches: RowMatches, twist: Array | None) -> Rows:
    """Return what is known of rows after the matches of a frame whose points move with a twist (6,); None: at rest."""
    speed = row_speed(rows.projection, matches.points, np.zeros(6) if twist is None else twist)
    return rows.learnt(matches.left_px, matches.difference_px, speed)


def row_speed(projection: StereoProjection, points: Array, twist: Array) -> Array:
    """Return how fast (n,), px/s, homogeneous points (n, 4) that move with a twist (6,) cross the rows."""
    return velocities(projection, points, twist)[:, 3]


def align_in_both(
    aligners: Aligners, rows: Rows, turn: RightTurn, images: PreparedImages, candidates: Candidates
) -> AlignedViews:
    """Find the candidates (n) in the left image, and what is found there in the right one."""
    n = len(candidates.now)
    found, any_row_px, cov_px = np.zeros(n, bool), np.full((n, 4), np.nan), np.zeros((n, 4, 4))
    on_row = np.zeros(n, bool)
    for aligner, at in split(aligners, candidates.now.scale):
        some = candidates.keep(at)
        left = aligner.align_left(images, some.now.slots, some.left_warps, some.left_px)
        speed = row_speed(rows.projection, some.now.points, some.twist)
        right_px, error_grey = _align_right(aligner, rows.at(left.at_px, speed), turn, images, some, left)
        found[at], any_row_px[at] = left.found, np.concatenate([left.at_px, right_px], axis=1)
        on_row[at] = rows.agrees(left.at_px, right_px, speed, aligner.scale)
        cov_px[at] = aligner.noise.covariance(left.patches.gradients, left.error_grey, error_grey)
    z_px = any_row_px.copy()
    z_px[~on_row, 2:] = np.nan
    return AlignedViews(found, z_px, cov_px, any_row_px)


def _align_right(
    aligner: TemplateAligner,
    vertical_px: Array,
    turn: RightTurn,
    images: PreparedImages,
    candidates: Candidates,
    left: LeftViews,
) -> tuple[Array, Array]:
    """Positions (n, 2) in the right image, NaN where there is no match; grey deviations (n,).

    `vertical_px` (n,): by how much rows differ, which is taken out.
    """
    slots = candidates.now.slots
    start_u = candidates.right_u_px + left.at_px[:, 0] - candidates.left_px[:, 0]
    start_px = np.stack([start_u, left.at_px[:, 1] - vertical_px], axis=1)
    slanted = np.asarray(candidates.now.slopes.any(axis=1))  # of the others left and right patch are the same
    patches = left.patches.replaced(slanted, aligner.warped(slots[slanted], candidates.right_warps[slanted]))
    at_px, found, error_grey = aligner.find(images.grey(aligner.scale)[1], patches, turn.put_in(start_px))
    r, width = aligner.scale * aligner.config.window_radius_px, images.right.shape[1]
    found &= (at_px[:, 0] > r) & (at_px[:, 0] < width - 1 - r)
    at_px = turn.taken_out(at_px)
    at_px[:, 1] += vertical_px
    found &= error_grey < aligner.config.max_photometric_error
    return np.where(found[:, None], at_px, np.nan), error_grey


def row_errors(rows: Rows, left_px: Array, points: Array, twist: Array) -> Array:
    """Return what is not known of the rows of homogeneous points (n, 4) seen at left positions (n, 2): (n, k) px."""
    return rows.root(left_px, row_speed(rows.projection, points, twist))


def of_right_sides(errors: Array, z_px: Array) -> Array:
    """Return errors (n, k) of rows as those of views (n, 4): their principal components (n, 4, j) px."""
    unknown = np.zeros((len(z_px), 4, errors.shape[1]))
    unknown[:, 3] = np.where(np.isfinite(z_px[:, 2:3]), errors, 0.0)
    return principal(unknown)


def cov_of_rows_as_turn(projection: StereoProjection, errors: Array, z_px: Array) -> Array:
    """Return the covariance (3, 3) of the turn of the right camera that errors (n, k) of rows of views (n, 4) feign."""
    seen = np.isfinite(z_px[:, 2])
    by_turn = effects_of_turn(projection, z_px[seen, 2:])
    information = (by_turn.transpose(0, 2, 1) @ by_turn).sum(axis=0)
    turns = np.linalg.lstsq(information, by_turn[:, 1].T @ errors[seen], rcond=None)[0]
    return np.asarray(turns @ turns.T)


def update_depths(p: StereoProjection, tracks: Tracks, z_px: Array, cov_px: Array) -> Tracks:
    """Tracks (n) of the new camera put where they were seen: views (n, 4) with covariances (n, 4, 4).

    1/Z by a scalar Kalman update where the right side is seen.
    """
    rho = p.inverse_depth(z_px)
    var = (cov_px[:, 0, 0] + cov_px[:, 2, 2] - 2 * cov_px[:, 0, 2]) / (p.f_px * p.baseline_m) ** 2
    seen = np.isfinite(rho)
    before = FORGETTING * tracks.var_rho
    gain = np.where(seen, before / (before + np.where(seen, var, 1.0)), 0.0)
    predicted = tracks.points[:, 3]
    updated = predicted + gain * (np.where(seen, rho, 0.0) - predicted)
    return tracks.placed(p.rays(z_px), z_px[:, :2], cov_px[:, :2, :2], updated, (1 - gain) * before)
