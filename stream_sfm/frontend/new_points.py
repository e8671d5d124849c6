"""New points of a pair where tracks are missing: corners with a unique match on their row in the other image.

If hardly any are found, as in front of a bare wall, faint texture gets wide templates: once thirty pixels are averaged
into one, blotches of one grey value are corners too.
"""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..config.section import Section, expert
from ..geometry import Array
from ..geometry.stereo import MIN_INVERSE_DEPTH_SIGMAS
from ..geometry.view_stages import RawViews
from ..pictures.prepared import PreparedImages
from ..record import changed
from .aligned_views import turned_px
from .alignment import WIDE
from .state import FrontEndState, RightSides, Setup
from .templates import JUST_CUT
from .tracks import Tracks


class PointRules(Section, frozen=True, kw_only=True):
    """New points in an image pair."""

    # It is as accurate as every frame (medians over three starts on four logs), and a replay takes 3 % less CPU.
    period: Annotated[int, expert("search for new points in every n-th frame", 1, 100)] = 2
    # In the other frames, points are sought only if more than this share is missing.
    urgent_fraction: Annotated[float, expert("missing share of max_tracks that does not wait", 0, 1)] = 0.6
    # On KITTI this saves 1.2 of 16 ms with unchanged figures. Every second time, and on bare walls, it is the whole
    # row.
    search_factor: Annotated[float, expert("length of the search on a row, largest disparities", 1, 1000)] = 1.5
    search_margin_px: Annotated[float, expert("margin of the length of the search on a row, px", 0, 10_000)] = 16.0
    # This covers a whole-pixel match and its neighbour.
    match_tolerance_px: Annotated[float, expert("largest error of a match, px of the coarse image", 0.5, 50)] = 2.0
    # With a larger offset, a depth edge crosses the patch. On renders, RMS structure error over σ fell from 7.3 to
    # 2.7.
    max_halves_apart_px: Annotated[float, expert("largest offset of an inner half's match, px", 0.01, 1e8)] = 0.5
    # This is a guess that allows for the noise that neighbours share.
    std_grey: Annotated[float, expert("σ of a grey difference of left and right patch", 0.1, 1e8)] = 4.0
    # Up to twice as many are added. In a corridor with bare corners drift is 14 % without them, 0.2 % with them.
    bare_fraction: Annotated[float, expert("share of max_tracks below which templates are wide", 0, 1)] = 0.25
    # A slope of a quarter of a grey value per pixel, twice what noise and rounding leave in the reduced image.
    min_wide_response: Annotated[float, expert("least eigenvalue of gradients of wide templates", 1e-12, 1)] = 1e-6
    # This is half of the default patch, and so the same size in half-size images.
    match_radius_px: Annotated[int, expert("half width of the window correlated along the row, px", 1, 100)] = 5
    # Smoothing gives neighbours the same noise. There are as many matches as with all samples, in a third of the
    # time.
    match_spacing_px: Annotated[int, expert("spacing of the samples of a correlated window, px", 1, 100)] = 2
    # Chosen by hand: higher values reject blurred or slanted patches; lower ones admit wrong matches, most of which
    # the alignment and the check of halves reject.
    match_correlation: Annotated[float, expert("least correlation of a match", -1, 1)] = 0.75
    match_lead: Annotated[float, expert("lead in correlation over other matches on the row", 0, 2)] = 0.06
    match_neighbours_px: Annotated[int, expert("neighbours of a match that do not compete, px", 0, 1000)] = 2
    # Chosen by hand: on most surfaces the disparity changes more slowly.
    std_slope: Annotated[float, expert("prior σ of the disparity slope across a patch, px per px", 1e-3, 10)] = 0.15
    # Chosen by hand: a patch of 21 px then spans 10 px of disparity, more than a single surface does.
    max_slope: Annotated[float, expert("largest disparity slope, px per px", 0, 0.99)] = 0.5
    # χ² with two degrees of freedom at 0.999: an insignificant slope adds more noise than it removes bias.
    significant_slope: Annotated[float, expert("χ² beyond which a slope counts", 0, 1e8)] = 13.8
    # Further steps change no figure of the logs with ground truth.
    slant_steps: Annotated[int, expert("Gauss-Newton steps that find a slope", 1, 100)] = 3
    # Beyond it, it is another match.
    max_slant_shift_px: Annotated[float, expert("largest shift of a match by its slope, px", 0, 100)] = 2.0
    # Chosen by hand. With a fixed limit, an exposure cut to a quarter would leave no corner.
    dim_fraction: Annotated[float, expert("share of the strongest response that makes a corner", 0, 1)] = 0.02
    peak_part: Annotated[int, expert("a corner is the strongest within the least distance over this", 1, 1000)] = 3
    # A cell has room for one corner at least.
    cell_distances: Annotated[float, expert("least edge of a cell, distances of corners", 0, 1000)] = 2.0
    # More candidates are weaker and cost time.
    candidates: Annotated[int, expert("candidates per corner wanted", 1, 10_000)] = 12


def renews(frame_index: int, period: int) -> bool:
    """Whether this frame adds new points even if few are missing; other frames do so only if most are."""
    return frame_index % period == 0


def begin_points(setup: Setup, state: FrontEndState, images: PreparedImages) -> tuple[FrontEndState, RawViews, Array]:
    """Begin tracks where they are missing, and return their views (k, 4) and covariances (k, 4, 4)."""
    z_px, cov_px = np.empty((0, 4)), np.empty((0, 4, 4))
    cfg, rules = setup.config.frontend, setup.rules.of(PointRules)
    enough = cfg.renew_fraction if renews(state.frame_index, rules.period) else rules.urgent_fraction
    if state.tracks.missing(cfg.max_tracks) >= cfg.max_tracks * enough:
        corners, disparity_px = _match_along_row(setup, state, images)
        tolerance_px = min(rules.match_tolerance_px / images.scale, 2 * cfg.max_vertical_disparity_px)
        state, z_px, cov_px = _begin(setup, state, images, 1, corners, disparity_px, tolerance_px)
    bare = rules.bare_fraction * cfg.max_tracks
    if len(state.tracks) < bare:
        matches = _match_wide(setup, state, images, int(2 * bare) - len(state.tracks))
        state, z_wide, cov_wide = _begin(setup, state, images, WIDE, *matches, rules.match_tolerance_px)
        z_px, cov_px = np.concatenate([z_px, z_wide]), np.concatenate([cov_px, cov_wide])
    return state, RawViews(z_px), cov_px


def detect_missing(setup: Setup, state: FrontEndState, images: PreparedImages) -> NDArray[np.int64]:
    """Return up to as many corners (k, 2) as tracks are missing, in whole pixels of the coarse left image.

    They keep a distance from the tracks.
    """
    cfg, scale, every = setup.config.frontend, images.scale, round(1 / images.scale)
    return core.new_corners(
        images.corner_strength,
        state.aligners[1].area[::every, ::every],
        state.tracks.left_px * scale,
        state.tracks.missing(cfg.max_tracks),
        cfg.min_corner_distance_px * scale,
        cfg.min_corner_response,
        setup.rules.of(PointRules),
    )


def begin_tracks(
    state: FrontEndState,
    slots: NDArray[np.intp],
    left_px: Array,
    cov_left_px: Array,
    points: Array,
    var_rho: Array,
    slopes: Array,
    scale: int = 1,
) -> FrontEndState:
    """Begin tracks at left positions (n, 2) with covariances (n, 2, 2).

    Their templates are in `slots` (n,), their homogeneous points (n, 4) have variances (n,) of 1/Z and slopes (n, 2).
    """
    n = len(slots)
    new = Tracks(
        ids=state.next_id + np.arange(n, dtype=np.int64),
        slots=slots,
        left_px=left_px,
        cov_left_px=cov_left_px,
        points=points,
        var_rho=var_rho,
        anchor_from_start=np.broadcast_to(state.cam_from_start, (n, 4, 4)),
        anchor_rays=points[:, :2],
        anchor_velocity_px_s=np.zeros((n, 2)),
        slopes=slopes,
        exposures=np.tile(JUST_CUT, (n, 1)),
        contrast=np.full(n, np.nan),
        scale=np.full(n, scale, np.int64),
        agreed=np.zeros(n, np.int64),
    )
    if state.timing.twist is not None:
        new = new.begun_with(state.timing.projection, state.timing.twist)
    return changed(state, next_id=state.next_id + n, tracks=state.tracks.append(new))


def _begin(
    setup: Setup,
    state: FrontEndState,
    images: PreparedImages,
    scale: int,
    corners: NDArray[np.intp],
    disparity_px: Array,
    tolerance_px: float,
) -> tuple[FrontEndState, Array, Array]:
    """Begin tracks at those corners (k, 2) that fit in both images, and return their views and covariances.

    Corners, their disparities (k,) and the tolerance of these are in pixels of templates of that scale.
    """
    if not len(corners):
        return state, np.empty((0, 4)), np.empty((0, 4, 4))
    taken = state.tracks.slots[state.tracks.scale == scale]
    aligner, slots = state.aligners[scale].cut(images, corners, taken)
    state = changed(state, aligners={**state.aligners, scale: aligner})
    twist = np.zeros(6) if state.timing.twist is None else state.timing.twist
    of_templates = *images.grey(scale), aligner.atlas.grey, aligner, state.right_sides(twist)
    slots, z_px, cov_px, slopes, apart_px = core.match_new_points(
        *of_templates, corners, slots, disparity_px, tolerance_px, setup.rules.of(PointRules)
    )
    state, right_sides = _learn_rows(state, z_px, twist) if scale == 1 else (state, state.right_sides(twist))
    # if σ of a wide template's position is more than half of its pixels, it is noise or a bare edge
    gates = MIN_INVERSE_DEPTH_SIGMAS, np.inf if scale == 1 else WIDE / 2
    rows, z_px, points, var_rho = core.place_new_points(right_sides, state.timing, z_px, cov_px, scale, *gates)
    if setup.right_area is not None:
        seen = ~setup.unseen_in_right(z_px)
        rows, z_px, points, var_rho = rows[seen], z_px[seen], points[seen], var_rho[seen]
    cov_px, slopes = cov_px[rows], slopes[rows] / setup.projection.baseline_m
    turn_left = np.zeros((3, 0)) if state.turn_watch is None else state.turn_watch.root_left
    by_turn_px2 = (core.with_turn(setup.projection, z_px, cov_px, turn_left) - cov_px)[:, 2, 2]
    var_rho = var_rho + by_turn_px2 / (setup.projection.f_px * setup.projection.baseline_m) ** 2
    begun = z_px[:, :2], cov_px[:, :2, :2], points, var_rho, slopes, scale
    errors = state.errors.with_new(state.next_id + np.arange(len(rows), dtype=np.int64), apart_px[rows])
    state = begin_tracks(changed(state, errors=errors), slots[rows], *begun)
    return state, z_px + turned_px(setup.projection, z_px, state.unusual_rad), state.rows.of_matches(cov_px)


def _learn_rows(state: FrontEndState, z_px: Array, twist: Array) -> tuple[FrontEndState, RightSides]:
    """Learn the row differences from new views (n, 4), and return the right sides that follow.

    While the velocity is unknown, the state keeps the views until the next frame, because a late camera would look like
    wrong rows.
    """
    learnt = changed(state, rows=state.rows.after(z_px, twist, state.timing.std_turning))
    now = changed(state, rows_waiting=z_px) if state.timing.twist is None else learnt
    return now, learnt.right_sides(twist)


def _match_along_row(setup: Setup, state: FrontEndState, images: PreparedImages) -> tuple[NDArray[np.intp], Array]:
    """Return new corners (k, 2) in whole pixels with a unique match on their row, and its rough disparity (k,)."""
    scale, corners = images.scale, detect_missing(setup, state, images)
    limits = _disparity_range(setup, state, scale)
    disparity, unique = core.match_along_rows(*images.coarse, corners, *limits, setup.rules.of(PointRules))
    return corners[unique] * round(1 / scale), disparity[unique] / scale


def _match_wide(
    setup: Setup, state: FrontEndState, images: PreparedImages, wanted: int
) -> tuple[NDArray[np.intp], Array]:
    """Do the same as `_match_along_row` for faint corners, in pixels of the reduced images."""
    left, right = images.quarter_grey
    corners = core.new_corners(
        core.corner_strength(left),
        state.aligners[WIDE].area[::WIDE, ::WIDE],
        state.tracks.left_px / WIDE,
        wanted,
        setup.config.frontend.min_corner_distance_px,
        setup.rules.of(PointRules).min_wide_response,
        setup.rules.of(PointRules),
    )
    limits = _disparity_range(setup, state, 1 / WIDE)
    disparity, unique = core.match_along_rows(left, right, corners, *limits, setup.rules.of(PointRules))
    return corners[unique], disparity[unique]


def _disparity_range(setup: Setup, state: FrontEndState, scale: float) -> tuple[int, int]:
    """Return the first and last disparity to search, px of the scaled image."""
    p, cfg, rules, tracks = setup.projection, setup.config.frontend, setup.rules.of(PointRules), state.tracks
    far = p.cx_left_px - p.cx_right_px
    near = far + cfg.max_disparity_fraction * p.width
    if state.frame_index % (2 * rules.period) and len(tracks) > rules.bare_fraction * cfg.max_tracks:
        largest = p.f_px * p.baseline_m * float(tracks.points[:, 3].max())
        near = min(near, far + rules.search_factor * largest + rules.search_margin_px)
    return int(np.floor(far * scale)) - 1, int(np.ceil(near * scale))
