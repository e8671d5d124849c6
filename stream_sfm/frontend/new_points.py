"""New points of a pair where tracks are missing: corners that are unique on their row and fit in both images.

Where hardly any are found, in front of a bare wall, what faint texture there is gets wide templates: blotches of one
grey value are corners too, once thirty pixels are averaged into one.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from .alignment import WIDE, TemplateAligner, TemplateAligners
from .corners import corner_strength, detect
from .depth_source import RowMatches, StereoDepth, row_speed
from .disparity_bias import DisparityBias
from .prepared import PreparedImages
from .slant import disparity_slopes
from .stereo_matching import match_along_rows
from .tracker import Tracker
from .warps import facing, sheared

# New points are sought in every second frame; in the others only where more than a fraction of the tracks is
# missing. As accurate as in each (medians over three starts on four logs), CPU of a replay 3 % less.
_RENEWAL_PERIOD = 2
_URGENT_FRACTION = 0.6
# Along the row the search covers 1.5 times the largest disparity of a track, plus a margin. Once per period, and
# where less than a fraction of the tracks is there, it covers the whole row. On KITTI 1.2 ms of 16 less with the
# figures unchanged.
_FULL_SEARCH_PERIOD = 4
_SEARCH_FACTOR, _SEARCH_MARGIN_PX = 1.5, 16.0
_FEW_TRACKS = 4  # the fraction: one of so many
_MATCH_TOLERANCE_PX = 2.0  # of the coarse images: a whole-pixel match, and its neighbour
# Between the matches of a whole patch and of its inner half, px: farther apart, a depth edge runs through the
# patch. With it the RMS of local structure error over σ went from 7.3 to 2.7 on rendered images.
_MAX_HALVES_APART_PX = 0.5
_MIN_INVERSE_DEPTH = -2.0  # standard deviations: points at infinity pass, wrong matches beyond it do not
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


@dataclass(frozen=True, slots=True)
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


class NewPoints:
    """Adds points to a tracker."""

    def __init__(self, tracker: Tracker, aligners: TemplateAligners, depth: StereoDepth) -> None:
        self.tracker = tracker
        self.aligners = aligners
        self.depth = depth
        self.turn = depth.turn
        self.projection = depth.projection
        self.config = depth.config
        self.bias = DisparityBias()

    def add(self, images: PreparedImages, frame_index: int) -> tuple[Array, Array]:
        """Begin tracks where they are missing; their views (k, 4) and covariances (k, 4, 4)."""
        z_px, cov_px = np.empty((0, 4)), np.empty((0, 4, 4))
        cfg, tracker = self.config, self.tracker
        enough = cfg.renew_fraction if renews(frame_index) else _URGENT_FRACTION
        if tracker.missing >= cfg.max_tracks * enough:
            corners, start = self._match_along_row(images, frame_index)
            tolerance_px = min(_MATCH_TOLERANCE_PX / images.scale, 2 * cfg.max_vertical_disparity_px)
            z_px, cov_px = self._begin(images, self.aligners.fine, corners, start, tolerance_px)
        bare = _BARE_FRACTION * cfg.max_tracks
        if len(tracker.tracks) < bare:
            corners, start = self._match_wide(images, int(2 * bare) - len(tracker.tracks))
            wide = self.aligners.by_scale[WIDE]
            z_wide, cov_wide = self._begin(images, wide, corners, start, _MATCH_TOLERANCE_PX)
            z_px, cov_px = np.concatenate([z_px, z_wide]), np.concatenate([cov_px, cov_wide])
        return z_px, cov_px

    def _begin(
        self,
        images: PreparedImages,
        aligner: TemplateAligner,
        corners: NDArray[np.intp],
        start: Array,
        tolerance: float,
    ) -> tuple[Array, Array]:
        """Begin tracks at those of the corners (k, 2) that fit in both images; their views and covariances.

        Corners, roughly known matches (k, 2) and how far off these may be, in pixels of the aligner's templates.
        """
        if not len(corners):
            return np.empty((0, 4)), np.empty((0, 4, 4))
        matches = self._align_right(images, aligner, corners, start, tolerance)
        matches = self._align_slanted(images, aligner, matches)
        matches = self._compare_halves(images, aligner, matches)
        matches = self._correct_rows(aligner, matches)
        return self._begin_tracks(aligner, matches)

    def _match_along_row(self, images: PreparedImages, frame_index: int) -> tuple[NDArray[np.intp], Array]:
        """New corners (k, 2) in whole pixels that have one match on their row, and roughly where (k, 2) it is."""
        scale, corners = images.scale, self.tracker.detect_corners(images)
        disparity, unique = match_along_rows(
            images.coarse_left(), images.coarse_right(), corners, self._disparity_range(scale, frame_index)
        )
        left_px = corners[unique] * round(1 / scale)
        return left_px, self._on_row(left_px, disparity[unique] / scale)

    def _match_wide(self, images: PreparedImages, wanted: int) -> tuple[NDArray[np.intp], Array]:
        """As `_match_along_row`, of faint corners, in pixels of the reduced images."""
        p, cfg = self.projection, self.config
        left, right = images.quarter_grey
        corners = detect(
            corner_strength(left / np.float32(255)),
            self.tracker.tracks.left_px / WIDE,
            self.aligners.by_scale[WIDE].area.coarse(WIDE),
            wanted,
            cfg.min_corner_distance_px,
            _MIN_WIDE_STRENGTH,
        )
        far = (p.cx_left_px - p.cx_right_px) / WIDE
        near = far + cfg.max_disparity_fraction * p.width / WIDE
        limits = int(np.floor(far)) - 1, int(np.ceil(near))
        disparity, unique = match_along_rows(left, right, corners, limits)
        corners = corners[unique]
        return corners, self._on_row(WIDE * corners, WIDE * disparity[unique]) / WIDE

    def _on_row(self, left_px: NDArray[np.intp], disparity_px: Array) -> Array:
        """Where in the right image (n, 2) pixels (n, 2) of the left one are, by the disparities (n,) seen there."""
        v = left_px[:, 1] - self.depth.rows.at(left_px.astype(float))
        right_px = np.stack([left_px[:, 0] - disparity_px, v], axis=1)
        right_px[:, 1] = self.turn.put_in(right_px)[:, 1]
        return right_px

    def _disparity_range(self, scale: float, frame_index: int) -> tuple[int, int]:
        """First and last disparity to search, px of the scaled image."""
        p, tracks = self.projection, self.tracker.tracks
        far = p.cx_left_px - p.cx_right_px
        near = far + self.config.max_disparity_fraction * p.width
        if frame_index % _FULL_SEARCH_PERIOD and len(tracks) > self.config.max_tracks // _FEW_TRACKS:
            largest = p.f_px * p.baseline_m * float(tracks.points[:, 3].max())
            near = min(near, far + _SEARCH_FACTOR * largest + _SEARCH_MARGIN_PX)
        return int(np.floor(far * scale)) - 1, int(np.ceil(near * scale))

    def _align_right(
        self,
        images: PreparedImages,
        aligner: TemplateAligner,
        left_px: NDArray[np.intp],
        start_px: Array,
        tolerance_px: float,
    ) -> _Matches:
        """Cut the templates and find them in the right image, as if their surfaces faced the camera."""
        tracks = self.tracker.tracks
        slots = aligner.cut(images, left_px, tracks.slots[tracks.scale == aligner.scale])
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

    def _align_slanted(self, images: PreparedImages, aligner: TemplateAligner, m: _Matches) -> _Matches:
        """Estimate the slant of the surfaces, and align anew where one is seen."""
        left, right = images.grey(aligner.scale)
        std_grey = _STD_GREY / aligner.scale  # a mean over pixels has so much less noise
        slopes = disparity_slopes(left, right, m.left_px, m.right_px, self.config.window_radius_px, std_grey)
        slanted = slopes.any(axis=1)
        patches = aligner.atlas.warped(m.slots[slanted], sheared(slopes[slanted]))
        right_px, error_grey = m.right_px.copy(), m.error_grey.copy()
        right_px[slanted], found, error_grey[slanted] = patches.align(right, right_px[slanted])
        good = error_grey < self.config.max_photometric_error
        good[slanted] &= found
        return replace(m, right_px=right_px, error_grey=error_grey, slopes=slopes, good=good)

    def _compare_halves(self, images: PreparedImages, aligner: TemplateAligner, m: _Matches) -> _Matches:
        """Match the inner halves alone: a patch across a depth edge follows the stronger side."""
        inner_px, found, _ = aligner.atlas.inner(m.slots).align(images.grey(aligner.scale)[1], m.right_px)
        apart_px = np.linalg.norm(inner_px - m.right_px, axis=1)
        return replace(m, apart_px=apart_px, good=m.good & found & (apart_px < _MAX_HALVES_APART_PX))

    def _correct_rows(self, aligner: TemplateAligner, m: _Matches) -> _Matches:
        """Learn the vertical disparity, take it out, and refuse matches that are still off their row.

        From here on everything is in image pixels.
        """
        scale = aligner.scale
        left_px, right_px = scale * m.left_px.astype(float), self.turn.taken_out(scale * m.right_px)
        z_px = np.concatenate([left_px, right_px], axis=1)
        points, twist = _points(self.projection, z_px), self.tracker.timing.twist
        rows = self.depth.rows
        speed = np.zeros(len(points)) if twist is None else row_speed(self.projection, points, twist)
        if scale == 1:
            at = m.good
            matches = RowMatches(left_px[at], (left_px - right_px)[at, 1], points[at])
            rows = self.depth.learn_rows(matches, twist)
        right_px[:, 1] += rows.at(left_px)
        good = m.good & rows.agrees(left_px, right_px, speed, scale)
        return replace(m, left_px=left_px, right_px=right_px, apart_px=scale * m.apart_px, good=good)

    def _begin_tracks(self, aligner: TemplateAligner, m: _Matches) -> tuple[Array, Array]:
        """Begin tracks of the good matches in front of the camera; their views (k, 4) and covariances (k, 4, 4)."""
        p = self.projection
        cov_px = aligner.noise.covariance(m.gradients, m.error_grey, m.error_grey)
        seen_px = np.concatenate([m.left_px, m.right_px], axis=1)
        taken_px = self._taken_out(seen_px)
        z_px = seen_px - taken_px
        rho = p.inverse_depth(z_px)
        var_rho = (cov_px[:, 0, 0] + cov_px[:, 2, 2]) / (p.f_px * p.baseline_m) ** 2
        good = m.good & (rho > _MIN_INVERSE_DEPTH * np.sqrt(var_rho))
        if aligner.scale > 1:
            good &= (np.diagonal(cov_px[:, :2, :2], axis1=1, axis2=2) < _MAX_WIDE_STD_PX**2).all(axis=1)
        slopes = m.slopes[good] / p.baseline_m
        new = self.tracker.add(
            m.slots[good],
            seen_px[good, :2],
            cov_px[good, :2, :2],
            rho[good],
            var_rho[good],
            slopes,
            taken_px[good, :2],
            aligner.scale,
        )
        self.bias.learn(new.ids, m.apart_px[good])
        return seen_px[good], cov_px[good]

    def _taken_out(self, z_px: Array) -> Array:
        """What is known of the timing of views (n, 4): (n, 4) px."""
        timing = self.tracker.timing
        twist = np.zeros(6) if timing.twist is None else timing.twist
        return timing.taken_out(_points(self.projection, z_px), twist)


def _points(projection: StereoProjection, z_px: Array) -> Array:
    """Homogeneous points (n, 4) of views (n, 4), in the camera that saw them."""
    return np.column_stack([projection.rays(z_px), np.ones(len(z_px)), projection.inverse_depth(z_px)])
