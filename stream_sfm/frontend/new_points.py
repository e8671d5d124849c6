"""New points of a pair where tracks are missing: corners that are unique on their row and fit in both images.

Where hardly any are found, in front of a bare wall, what faint texture there is gets wide templates: blotches of one
grey value are corners too, once thirty pixels are averaged into one.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry.se3 import Array
from ..geometry.stereo import MIN_INVERSE_DEPTH_SIGMAS, StereoProjection
from ..record import record
from .alignment import WIDE, TemplateAligner
from .corners import corner_strength, detect
from .prepared import PreparedImages
from .state import FrontEndState, Setup
from .stereo_depth import RowMatches, learn_rows, row_speed
from .tracks import Tracks
from .warps import facing, sheared

# New points are sought in every second frame; in the others only where more than a fraction of the tracks is
# missing. As accurate as in each (medians over three starts on four logs), CPU of a replay 3 % less.
_RENEWAL_PERIOD = 2
_URGENT_FRACTION = 0.6
# Along the row the search covers 1.5 times the largest disparity of a track, plus a margin. Once per period, and
# where less than `_BARE_FRACTION` of the tracks is there, it covers the whole row. On KITTI 1.2 ms of 16 less with the
# figures unchanged.
_FULL_SEARCH_PERIOD = 2 * _RENEWAL_PERIOD
_SEARCH_FACTOR, _SEARCH_MARGIN_PX = 1.5, 16.0
_MATCH_TOLERANCE_PX = 2.0  # of the coarse images: a whole-pixel match, and its neighbour
# Between the matches of a whole patch and of its inner half, px: farther apart, a depth edge runs through the
# patch. With it the RMS of local structure error over σ went from 7.3 to 2.7 on rendered images.
_MAX_HALVES_APART_PX = 0.5
# Of a grey difference of left and right patch, neighbours that share their noise counted in; a guess.
_STD_GREY = 4.0
# Wide templates are added where fewer than a fraction of the tracks is there, up to twice as many. In between, images
# with a few posters on a white wall have all they need: drift of a corridor with such corners 14 % without, .2 % with.
_BARE_FRACTION = 0.25
# Of corners in the reduced image, as `min_corner_response`: a slope of a quarter of a grey value per pixel, twice what
# noise and rounding leave there.
_MIN_WIDE_STRENGTH = 1e-6
_MAX_WIDE_STD_PX = 2.0  # of a wide template's position, image pixels: what is less certain is noise or a bare edge


def renews(frame_index: int) -> bool:
    """Whether new points are added in this frame where few are missing; in the others only where most are."""
    return frame_index % _RENEWAL_PERIOD == 0


@record
class _Matches:
    """Corners `left_px` (n, 2), whole pixels, with the slots (n,) of their templates; their matches `right_px` (n, 2);
    all in pixels of the templates until `_correct_rows`. `gradients` (n, 2, 2) of the templates; `error_grey` (n,);
    `slopes` (n, 2) of disparity; `apart_px` (n,) between the matches of whole patch and inner half; and which are
    `good` (n,) so far."""

    left_px: NDArray[Any]
    slots: NDArray[np.intp]
    right_px: Array
    gradients: Array
    error_grey: Array
    slopes: Array
    apart_px: Array
    good: NDArray[np.bool_]


def begin_points(setup: Setup, state: FrontEndState, images: PreparedImages) -> tuple[FrontEndState, Array, Array]:
    """Begin tracks where they are missing; their views (k, 4) and covariances (k, 4, 4)."""
    z_px, cov_px = np.empty((0, 4)), np.empty((0, 4, 4))
    cfg = setup.config.frontend
    enough = cfg.renew_fraction if renews(state.frame_index) else _URGENT_FRACTION
    if state.tracks.missing(cfg.max_tracks) >= cfg.max_tracks * enough:
        corners, start = _match_along_row(setup, state, images)
        tolerance_px = min(_MATCH_TOLERANCE_PX / images.scale, 2 * cfg.max_vertical_disparity_px)
        state, z_px, cov_px = _begin(setup, state, images, 1, corners, start, tolerance_px)
    bare = _BARE_FRACTION * cfg.max_tracks
    if len(state.tracks) < bare:
        corners, start = _match_wide(setup, state, images, int(2 * bare) - len(state.tracks))
        state, z_wide, cov_wide = _begin(setup, state, images, WIDE, corners, start, _MATCH_TOLERANCE_PX)
        z_px, cov_px = np.concatenate([z_px, z_wide]), np.concatenate([cov_px, cov_wide])
    return state, z_px, cov_px


def detect_missing(setup: Setup, state: FrontEndState, images: PreparedImages) -> NDArray[np.intp]:
    """Return at most as many corners (k, 2) as are missing, whole pixels of the coarse left image, away from tracks."""
    cfg, scale, every = setup.config.frontend, images.scale, round(1 / images.scale)
    return detect(
        images.corner_strength,
        state.tracks.left_px * scale,
        state.aligners[1].area[::every, ::every],
        state.tracks.missing(cfg.max_tracks),
        cfg.min_corner_distance_px * scale,
        cfg.min_corner_response,
    )


def begin_tracks(
    projection: StereoProjection,
    state: FrontEndState,
    slots: NDArray[np.intp],
    left_px: Array,
    cov_left_px: Array,
    rho: Array,
    var_rho: Array,
    slopes: Array,
    taken_px: Array,
    scale: int = 1,
) -> FrontEndState:
    """Begin tracks at left positions (n, 2) with covariances (n, 2, 2), templates in `slots` (n,), inverse depths (n,)
    with variances, and slopes (n, 2); `taken_px` (n, 2) is taken out of the positions to get the rays."""
    n = len(slots)
    rays = projection.rays(left_px - taken_px)
    new = Tracks(
        ids=state.next_id + np.arange(n, dtype=np.int64),
        slots=slots,
        left_px=left_px,
        cov_left_px=cov_left_px,
        points=np.concatenate([rays, np.ones((n, 1)), rho[:, None]], axis=1),
        var_rho=var_rho,
        anchor_from_start=np.broadcast_to(state.cam_from_start, (n, 4, 4)),
        anchor_rays=rays,
        slopes=slopes,
        scale=np.full(n, scale, np.int64),
        agreed=np.zeros(n, np.int64),
    )
    return replace(state, next_id=state.next_id + n, tracks=state.tracks.append(new))


def _begin(
    setup: Setup,
    state: FrontEndState,
    images: PreparedImages,
    scale: int,
    corners: NDArray[np.intp],
    start: Array,
    tolerance: float,
) -> tuple[FrontEndState, Array, Array]:
    """Begin tracks at those of the corners (k, 2) that fit in both images; their views and covariances.

    Corners, roughly known matches (k, 2) and how far off these may be, in pixels of templates of that scale.
    """
    if not len(corners):
        return state, np.empty((0, 4)), np.empty((0, 4, 4))
    taken = state.tracks.slots[state.tracks.scale == scale]
    aligner, slots = state.aligners[scale].cut(images, corners, taken)
    state = replace(state, aligners={**state.aligners, scale: aligner})
    matches = _align_right(aligner, images, corners, slots, start, tolerance)
    matches = _align_slanted(aligner, images, matches)
    matches = _compare_halves(aligner, images, matches)
    state, matches = _correct_rows(setup, state, scale, matches)
    return _begin_tracks(setup, state, aligner, matches)


def _match_along_row(setup: Setup, state: FrontEndState, images: PreparedImages) -> tuple[NDArray[np.intp], Array]:
    """Return new corners (k, 2) in whole pixels with a unique match on their row, and its rough position (k, 2)."""
    scale, corners = images.scale, detect_missing(setup, state, images)
    limits = _disparity_range(setup, state, scale)
    disparity, unique = core.match_along_rows(images.coarse_left(), images.coarse_right(), corners, *limits)
    left_px = corners[unique] * round(1 / scale)
    return left_px, _on_row(state, left_px, disparity[unique] / scale)


def _match_wide(
    setup: Setup, state: FrontEndState, images: PreparedImages, wanted: int
) -> tuple[NDArray[np.intp], Array]:
    """As `_match_along_row`, of faint corners, in pixels of the reduced images."""
    p, cfg = setup.projection, setup.config.frontend
    left, right = images.quarter_grey
    corners = detect(
        corner_strength(left / np.float32(255)),
        state.tracks.left_px / WIDE,
        state.aligners[WIDE].area[::WIDE, ::WIDE],
        wanted,
        cfg.min_corner_distance_px,
        _MIN_WIDE_STRENGTH,
    )
    far = (p.cx_left_px - p.cx_right_px) / WIDE
    near = far + cfg.max_disparity_fraction * p.width / WIDE
    disparity, unique = core.match_along_rows(left, right, corners, int(np.floor(far)) - 1, int(np.ceil(near)))
    corners = corners[unique]
    return corners, _on_row(state, WIDE * corners, WIDE * disparity[unique]) / WIDE


def _on_row(state: FrontEndState, left_px: NDArray[np.intp], disparity_px: Array) -> Array:
    """Where in the right image (n, 2) pixels (n, 2) of the left one are, by the disparities (n,) seen there."""
    at_px = left_px.astype(float)
    right_px = at_px - np.stack([disparity_px, np.zeros(len(at_px))], axis=1)
    right_px[:, 1] -= state.rows_told.at(at_px, _row_speed(state, np.concatenate([at_px, right_px], axis=1)))
    right_px[:, 1] = state.turn.put_in(right_px)[:, 1]
    return right_px


def _disparity_range(setup: Setup, state: FrontEndState, scale: float) -> tuple[int, int]:
    """First and last disparity to search, px of the scaled image."""
    p, cfg, tracks = setup.projection, setup.config.frontend, state.tracks
    far = p.cx_left_px - p.cx_right_px
    near = far + cfg.max_disparity_fraction * p.width
    if state.frame_index % _FULL_SEARCH_PERIOD and len(tracks) > _BARE_FRACTION * cfg.max_tracks:
        largest = p.f_px * p.baseline_m * float(tracks.points[:, 3].max())
        near = min(near, far + _SEARCH_FACTOR * largest + _SEARCH_MARGIN_PX)
    return int(np.floor(far * scale)) - 1, int(np.ceil(near * scale))


def _align_right(
    aligner: TemplateAligner,
    images: PreparedImages,
    left_px: NDArray[np.intp],
    slots: NDArray[np.intp],
    start_px: Array,
    tolerance_px: float,
) -> _Matches:
    """Find the new templates in the right image, as if their surfaces faced the camera."""
    patches = aligner.atlas.warped(slots, facing(len(slots)))
    right_px, found, error_grey = patches.align(images.grey(aligner.scale)[1], start_px)
    ok = found & (np.linalg.norm(right_px - start_px, axis=1) < tolerance_px)
    n = int(ok.sum())
    return _Matches(
        left_px=left_px[ok],
        slots=slots[ok],
        right_px=right_px[ok],
        gradients=patches.gradients[ok],
        error_grey=error_grey[ok],
        slopes=np.zeros((n, 2)),
        apart_px=np.zeros(n),
        good=np.ones(n, bool),
    )


def _align_slanted(aligner: TemplateAligner, images: PreparedImages, m: _Matches) -> _Matches:
    """Estimate the slant of the surfaces, and realign the slanted ones."""
    left, right = images.grey(aligner.scale)
    std_grey = _STD_GREY / aligner.scale  # a mean over pixels has so much less noise
    slopes = core.disparity_slopes(left, right, m.left_px, m.right_px, aligner.config.window_radius_px, std_grey)
    slanted = slopes.any(axis=1)
    patches = aligner.atlas.warped(m.slots[slanted], sheared(slopes[slanted]))
    right_px, error_grey = m.right_px.copy(), m.error_grey.copy()
    right_px[slanted], found, error_grey[slanted] = patches.align(right, right_px[slanted])
    good = error_grey < aligner.config.max_photometric_error
    good[slanted] &= found
    return replace(m, right_px=right_px, error_grey=error_grey, slopes=slopes, good=good)


def _compare_halves(aligner: TemplateAligner, images: PreparedImages, m: _Matches) -> _Matches:
    """Match the inner halves alone: a patch across a depth edge follows the stronger side."""
    inner_px, found, _ = aligner.atlas.inner(m.slots).align(images.grey(aligner.scale)[1], m.right_px)
    apart_px = np.linalg.norm(inner_px - m.right_px, axis=1)
    return replace(m, apart_px=apart_px, good=m.good & found & (apart_px < _MAX_HALVES_APART_PX))


def _correct_rows(setup: Setup, state: FrontEndState, scale: int, m: _Matches) -> tuple[FrontEndState, _Matches]:
    """Learn the vertical disparity, take it out, and refuse matches that are still off their row.

    From here on everything is in image pixels. While the velocity is unknown, the matches also wait for that of the
    next frame: a late camera would look like wrong rows.
    """
    left_px, right_px = scale * m.left_px.astype(float), state.turn.taken_out(scale * m.right_px)
    z_px = np.concatenate([left_px, right_px], axis=1)
    speed, twist = _row_speed(state, z_px), state.timing.twist
    if scale == 1:
        at = m.good
        matches = RowMatches(left_px[at], (left_px - right_px)[at, 1], _points(setup.projection, z_px[at]))
        learnt = replace(state, rows=learn_rows(state.rows, matches, twist))
        state, rows = (replace(state, rows_waiting=matches) if twist is None else learnt), learnt.rows_told
    else:
        rows = state.rows_told
    right_px[:, 1] += rows.at(left_px, speed)
    good = m.good & rows.agrees(left_px, right_px, speed, scale)
    return state, replace(m, left_px=left_px, right_px=right_px, apart_px=scale * m.apart_px, good=good)


def _row_speed(state: FrontEndState, z_px: Array) -> Array:
    """How fast views (n, 4) cross the rows, px/s; 0 before there was a motion."""
    if state.timing.twist is None:
        return np.zeros(len(z_px))
    projection = state.rows.projection
    return row_speed(projection, _points(projection, z_px), state.timing.twist)


def _begin_tracks(
    setup: Setup, state: FrontEndState, aligner: TemplateAligner, m: _Matches
) -> tuple[FrontEndState, Array, Array]:
    """Begin tracks of the good matches in front of the camera; their views (k, 4) and covariances (k, 4, 4)."""
    p, first_id = setup.projection, state.next_id
    cov_px = aligner.noise.covariance(m.gradients, m.error_grey, m.error_grey)
    seen_px = np.concatenate([m.left_px, m.right_px], axis=1)
    twist = np.zeros(6) if state.timing.twist is None else state.timing.twist
    taken_px = state.timing.taken_out(_points(p, seen_px), twist)
    rho = p.inverse_depth(seen_px - taken_px)
    var_rho = (cov_px[:, 0, 0] + cov_px[:, 2, 2]) / (p.f_px * p.baseline_m) ** 2
    good = m.good & (rho > MIN_INVERSE_DEPTH_SIGMAS * np.sqrt(var_rho))
    if aligner.scale > 1:
        good &= (np.diagonal(cov_px[:, :2, :2], axis1=1, axis2=2) < _MAX_WIDE_STD_PX**2).all(axis=1)
    state = begin_tracks(
        p,
        state,
        m.slots[good],
        seen_px[good, :2],
        cov_px[good, :2, :2],
        rho[good],
        var_rho[good],
        m.slopes[good] / p.baseline_m,
        taken_px[good, :2],
        aligner.scale,
    )
    new_ids = np.arange(first_id, state.next_id, dtype=np.int64)
    return replace(state, bias=state.bias.learnt(new_ids, m.apart_px[good])), seen_px[good], cov_px[good]


def _points(projection: StereoProjection, z_px: Array) -> Array:
    """Homogeneous points (n, 4) of views (n, 4), in the camera that saw them."""
    return np.column_stack([projection.rays(z_px), np.ones(len(z_px)), projection.inverse_depth(z_px)])
