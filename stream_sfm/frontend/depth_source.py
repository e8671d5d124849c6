"""Where the depths of tracks come from: the right image of a pair, or the parallax of one camera (`mono/parallax.py`).

The tracker is the same for both; this is all that it asks.
"""

from typing import Protocol

import numpy as np

from ..config import FrontendConfig
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from .alignment import AlignedViews, Candidates, LeftViews, TemplateAligner, TemplateAligners
from .prepared import PreparedImages
from .right_turn import RightTurn
from .tracks import Tracks
from .vertical_disparity import VerticalDisparity

# Of the variance of inverse depth, per frame: a tenth more each time forgets depths that a wrong motion carried
# along. Chosen by hand: less forgetting is slower to recover, more gives away what earlier views said.
FORGETTING = 1.1


class DepthSource(Protocol):
    """What a tracker needs to know about depths."""

    def align(self, images: PreparedImages, candidates: Candidates) -> AlignedViews:
        """Find the candidates (n) in the new images."""
        ...

    def update(self, tracks: Tracks, z_px: Array, cov_px: Array, cam_from_start: Array) -> Tracks:
        """Tracks (n) of the new camera put where they were seen: views (n, 4) with covariances (n, 4, 4)."""
        ...


class StereoDepth:
    """Depths from the right image: every track is aligned in it, too, and its disparity measured in each frame."""

    def __init__(self, projection: StereoProjection, config: FrontendConfig, aligners: TemplateAligners) -> None:
        self.projection = projection
        self.config = config
        self.aligners = aligners
        self.vertical_disparity = VerticalDisparity(projection, config.max_vertical_disparity_px)
        self.turn = RightTurn(projection)

    def align(self, images: PreparedImages, candidates: Candidates) -> AlignedViews:
        """Find the candidates (n) in the left image, and what is found there in the right one."""
        n = len(candidates.now)
        found, any_row_px, cov_px = np.zeros(n, bool), np.full((n, 4), np.nan), np.zeros((n, 4, 4))
        on_row = np.zeros(n, bool)
        for aligner, rows in self.aligners.split(candidates.now.scale):
            some = candidates.keep(rows)
            left = aligner.align_left(images, some.now.slots, some.left_warps, some.left_px)
            right_px, error_grey = self._align_right(aligner, images, some, left)
            found[rows], any_row_px[rows] = left.found, np.concatenate([left.at_px, right_px], axis=1)
            on_row[rows] = self.vertical_disparity.agrees(left.at_px, right_px, aligner.scale)
            cov_px[rows] = aligner.noise.covariance(left.patches.gradients, left.error_grey, error_grey)
        z_px = any_row_px.copy()
        z_px[~on_row, 2:] = np.nan
        return AlignedViews(found, z_px, cov_px, any_row_px)

    def _align_right(
        self, aligner: TemplateAligner, images: PreparedImages, candidates: Candidates, left: LeftViews
    ) -> tuple[Array, Array]:
        """Positions (n, 2) in the right image, rows corrected, NaN where there is no match; grey deviations (n,)."""
        slots = candidates.now.slots
        vertical_px = self.vertical_disparity.at(left.at_px)
        start_u = candidates.right_u_px + left.at_px[:, 0] - candidates.left_px[:, 0]
        start_px = np.stack([start_u, left.at_px[:, 1] - vertical_px], axis=1)
        slanted = np.asarray(candidates.now.slopes.any(axis=1))  # of the others left and right patch are the same
        patches = left.patches.replaced(slanted, aligner.warped(slots[slanted], candidates.right_warps[slanted]))
        at_px, found, error_grey = aligner.find(images.grey(aligner.scale)[1], patches, self.turn.put_in(start_px))
        r, width = aligner.scale * self.config.window_radius_px, images.right.shape[1]
        found &= (at_px[:, 0] > r) & (at_px[:, 0] < width - 1 - r)
        at_px = self.turn.taken_out(at_px)
        at_px[:, 1] += vertical_px
        found &= error_grey < self.config.max_photometric_error
        return np.where(found[:, None], at_px, np.nan), error_grey

    def update(self, tracks: Tracks, z_px: Array, cov_px: Array, cam_from_start: Array) -> Tracks:
        """Tracks put where they were seen; 1/Z by a scalar Kalman update where the right side is seen."""
        p = self.projection
        rho = p.inverse_depth(z_px)
        var = (cov_px[:, 0, 0] + cov_px[:, 2, 2] - 2 * cov_px[:, 0, 2]) / (p.f_px * p.baseline_m) ** 2
        seen = np.isfinite(rho)
        before = FORGETTING * tracks.var_rho
        gain = np.where(seen, before / (before + np.where(seen, var, 1.0)), 0.0)
        predicted = tracks.points[:, 3]
        updated = predicted + gain * (np.where(seen, rho, 0.0) - predicted)
        return tracks.placed(p.rays(z_px), z_px[:, :2], cov_px[:, :2, :2], updated, (1 - gain) * before)
