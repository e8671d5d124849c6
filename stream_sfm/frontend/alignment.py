"""Alignment of tracks: their anchored templates, warped as today's images should show them, found in the left image.

What a track is aligned with in the right image, if there is one, is said by its source of depth (`depth_source.py`).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import FrontendConfig
from ..geometry.se3 import Array
from .noise import ViewNoise
from .prepared import PreparedImages
from .templates import Patches, TemplateAtlas
from .tracks import Tracks
from .valid_area import ValidArea


@dataclass(frozen=True, slots=True)
class Candidates:
    """Tracks (n) whose patches should be in a new frame, as a rough motion predicts them.

    `before`: the tracks in the previous camera; `now`: the same in the new one. Alignment starts at `left_px` (n, 2)
    and in column `right_u_px` (n,), with the warps `left_warps`, `right_warps` (n, 3, 2), anchor from now.
    """

    before: Tracks
    now: Tracks
    left_px: Array
    right_u_px: Array
    left_warps: Array
    right_warps: Array

    def keep(self, rows: NDArray[Any]) -> "Candidates":
        """The given rows (mask or indices)."""
        return Candidates(
            self.before.keep(rows),
            self.now.keep(rows),
            self.left_px[rows],
            self.right_u_px[rows],
            self.left_warps[rows],
            self.right_warps[rows],
        )


@dataclass(frozen=True, slots=True)
class AlignedViews:
    """Views of candidates (n): which were `found` (n,), at least on the left; `z_px` (n, 4), NaN where the right side
    was not found; `cov_px` (n, 4, 4)."""

    found: NDArray[np.bool_]
    z_px: Array
    cov_px: Array


@dataclass(frozen=True, slots=True)
class LeftViews:
    """Left sides of views (n): positions `at_px` (n, 2), deviation `error_grey` (n,) of the grey differences that are
    left, which were `found` (n,), and the `patches` that were aligned."""

    at_px: Array
    error_grey: Array
    found: NDArray[np.bool_]
    patches: Patches


class TemplateAligner:
    """The templates of all tracks, and where in new images they are."""

    def __init__(self, config: FrontendConfig, valid: NDArray[np.bool_]) -> None:
        self.config = config
        self.area = ValidArea(valid, config.window_radius_px)
        self.atlas = TemplateAtlas(2 * config.max_tracks, config.window_radius_px)
        self.noise = ViewNoise(config.smoothing_px, config.window_radius_px)

    def visible(self, candidates: Candidates) -> Candidates:
        """Those whose templates can be warped as the images need them, and that start inside the image."""
        fit = self.atlas.fits(candidates.left_warps) & self.atlas.fits(candidates.right_warps)
        return candidates.keep(fit & self.area.contains(candidates.left_px))

    def align_left(
        self, images: PreparedImages, slots: NDArray[np.intp], warps: Array, start_px: Array
    ) -> LeftViews:
        """Find the templates of `slots` (n,), warped (n, 3, 2), in the left image near starts (n, 2)."""
        patches = self.atlas.warped(slots, warps)
        at_px, found, error_grey = patches.align(images.left_grey, start_px)
        near = np.linalg.norm(at_px - start_px, axis=1) < self.config.max_realignment_px
        fits = error_grey < self.config.max_photometric_error
        return LeftViews(at_px, error_grey, found & near & fits & self.area.contains(at_px), patches)

    def cut(
        self, images: PreparedImages, corners_px: NDArray[np.intp], taken: NDArray[np.intp]
    ) -> NDArray[np.intp]:
        """Cut new templates around whole pixels (n, 2) of the left image; their slots (n,), none of those `taken`."""
        free = np.setdiff1d(np.arange(2 * self.config.max_tracks), taken)[: len(corners_px)]
        self.atlas.store(images.left_grey, corners_px, free)
        return free
