"""Alignment of tracks: their anchored templates, warped as today's images should show them, found in the left image.

What a track is aligned with in the right image, if there is one, is said where its depth comes from (`stereo_depth.py`,
`mono/parallax.py`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..config import FrontendConfig
from ..geometry.resection import Resection
from ..geometry.se3 import Array
from ..record import indices, record, rows_of
from .noise import ViewNoise
from .prepared import PreparedImages
from .templates import SPACING_PX, TemplateAtlas
from .tracks import Tracks, takes_all
from .valid_area import contains, valid_area

WIDE = 4  # image pixels per template pixel of wide templates, for nearly textureless surfaces


@record
class Candidates:
    """Tracks (n) whose patches should be in a new frame, as a rough motion predicts them.

    `before`: the tracks in the previous camera; `points` (n, 4) in the new one. Alignment starts at `left_px` (n, 2)
    and in column `right_u_px` (n,), with the warps `left_warps`, `right_warps` (n, 3, 2), anchor from now.
    `twist` (6,): how the points move in the camera, per second.
    """

    before: Tracks
    points: Array
    left_px: Array
    right_u_px: Array
    left_warps: Array
    right_warps: Array
    twist: Array

    def keep(self, rows: NDArray[Any] | slice) -> "Candidates":
        """The given rows (mask, indices or slice)."""
        if takes_all(rows):
            return self
        rows = indices(rows)
        return Candidates(
            self.before.keep(rows),
            rows_of(self.points, rows),
            rows_of(self.left_px, rows),
            rows_of(self.right_u_px, rows),
            rows_of(self.left_warps, rows),
            rows_of(self.right_warps, rows),
            self.twist,
        )

    @property
    def of_core(self) -> tuple[NDArray[np.intp], Array, Array, Array, Array, Array, Array, Array]:
        """What of them the compiled core aligns."""
        of_tracks = self.before.slots, self.points, self.before.slopes
        return *of_tracks, self.left_px, self.right_u_px, self.left_warps, self.right_warps, self.twist


@record
class AlignedViews:
    """Views of candidates (n): which were `found` (n,), at least on the left; `z_px` (n, 4), NaN where the right side
    was not found; `cov_px` (n, 4, 4). `any_row_px` (n, 4): the same, including right sides that miss their row."""

    found: NDArray[np.bool_]
    z_px: Array
    cov_px: Array
    any_row_px: Array

    @classmethod
    def none(cls, n: int) -> "AlignedViews":
        """Return views of which none was found."""
        return cls(np.zeros(n, bool), np.full((n, 4), np.nan), np.zeros((n, 4, 4)), np.full((n, 4), np.nan))

    def keep(self, rows: NDArray[np.bool_]) -> "AlignedViews":
        """The given rows."""
        if takes_all(rows):
            return self
        columns = self.found, self.z_px, self.cov_px, self.any_row_px
        return AlignedViews(*(rows_of(column, rows) for column in columns))

    def without(self, taken_px: Array) -> "AlignedViews":
        """Return the views with offsets (n, 4) px subtracted."""
        return replace(self, z_px=self.z_px - taken_px, any_row_px=self.any_row_px - taken_px)

    def left_only(self) -> "AlignedViews":
        """Without right sides."""
        z_px = self.z_px.copy()
        z_px[:, 2:] = np.nan
        return replace(self, z_px=z_px)


@record
class TemplateAligner:
    """Templates of one size, and the search for them in new images.

    With a `scale` of `WIDE` their pixels are that many image pixels wide: they are cut from the reduced images, and
    found in them. All positions, warps and covariances passed in or returned are in image pixels. `area` (h, w): pixels
    around which a whole patch shows the scene; `noise`: the covariance of a view.
    """

    config: FrontendConfig
    scale: int
    area: NDArray[np.bool_]
    atlas: TemplateAtlas
    noise: ViewNoise

    @classmethod
    def empty(cls, config: FrontendConfig, valid: NDArray[np.bool_], scale: int = 1) -> "TemplateAligner":
        """Return an aligner without templates; `valid` (h, w): pixels of the left image that hold picture."""
        radius_px = config.window_radius_px
        return cls(
            config,
            scale,
            valid_area(valid, scale * radius_px),
            TemplateAtlas.empty(2 * config.max_tracks, radius_px, of_bytes=scale == 1),
            ViewNoise.unknown(config.smoothing_px, radius_px, scale),
        )

    @property
    def of_core(self) -> tuple[int, int, int, float, float, float, float]:
        """The kind of these templates as the compiled core takes it."""
        cfg, noise = self.config, self.noise
        sizes = self.scale, cfg.window_radius_px, SPACING_PX
        return *sizes, cfg.max_realignment_px, cfg.max_photometric_error, noise.shared_pixels, noise.factor

    def visible(self, candidates: Candidates) -> NDArray[np.bool_]:
        """Return which templates (n,) can be warped this way and start inside the image."""
        warps = (self._in_template_pixels(w) for w in (candidates.left_warps, candidates.right_warps))
        fit = np.logical_and(*(self.atlas.fits(w) for w in warps))
        return np.asarray(fit & contains(self.area, candidates.left_px))

    def align_left(
        self, images: PreparedImages, slots: NDArray[np.intp], warps: Array, start_px: Array
    ) -> AlignedViews:
        """Find templates of `slots` (n,), warped by (n, 3, 2), in the left image near starts (n, 2)."""
        of_left = images.grey(self.scale)[0], self.atlas.grey, self.area
        return AlignedViews(*core.align_left(*of_left, self.of_core, slots, warps, start_px))

    def cut(
        self, images: PreparedImages, corners: NDArray[np.intp], taken: NDArray[np.intp]
    ) -> tuple["TemplateAligner", NDArray[np.intp]]:
        """Cut new templates around whole template pixels (n, 2) of the left image.

        Returns the aligner with them, and their slots (n,), none of `taken`.
        """
        is_free = np.ones(2 * self.config.max_tracks, bool)
        is_free[taken] = False
        free = np.flatnonzero(is_free)[: len(corners)]
        return replace(self, atlas=self.atlas.stored(images.grey(self.scale)[0], corners, free)), free

    def _in_template_pixels(self, warps: Array) -> Array:
        """Warps (n, 3, 2) of image pixels; their last row is per pixel."""
        return warps if self.scale == 1 else warps * np.array([1.0, 1.0, self.scale])[:, None]


# One aligner per size of templates, by scale.
Aligners = Mapping[int, TemplateAligner]


def split(
    aligners: Aligners, scale: NDArray[np.int64]
) -> Iterator[tuple[TemplateAligner, NDArray[np.bool_] | slice]]:
    """The aligners of tracks with that `scale` (n,), each with its rows: mask (n,), or a slice of all."""
    for size, aligner in aligners.items():
        rows = scale == size
        if rows.all():
            yield aligner, slice(None)
            return
        if rows.any():
            yield aligner, rows


def visible(aligners: Aligners, candidates: Candidates) -> Candidates:
    """Return the candidates whose templates can be warped and that start inside the image."""
    kept = np.zeros(len(candidates.before), bool)
    for aligner, rows in split(aligners, candidates.before.scale):
        kept[rows] = aligner.visible(candidates.keep(rows))
    return candidates.keep(kept)


def drift(aligners: Aligners, tracks: Tracks, cam_from_previous: Array) -> Array:
    """Standard deviation (n,) px of how far templates slid since the last frame, eq. (17)."""
    drift_px = np.zeros(len(tracks))
    for aligner, rows in split(aligners, tracks.scale):
        drift_px[rows] = aligner.noise.drift(tracks.points[rows], cam_from_previous)
    return drift_px


def learn_noise(aligners: Aligners, motion: Resection, scale: NDArray[np.int64], z_px: Array) -> Aligners:
    """The aligners after a frame: each size's noise by the squared residuals of its accepted views.

    Tracks with that `scale` (n,), their views (n, 4).
    """
    learnt = dict(aligners)
    for aligner, rows in split(aligners, scale):
        used = np.zeros(len(scale), bool)
        used[rows] = motion.accepted[rows]
        n = int(np.isfinite(z_px[used]).sum())
        fitted = round(6 * n / max(1, motion.dof + 6))  # their share of the motion
        noise = aligner.noise.learnt(float(motion.squared_residuals[used].sum()), n - fitted)
        learnt[aligner.scale] = replace(aligner, noise=noise)
    return learnt
