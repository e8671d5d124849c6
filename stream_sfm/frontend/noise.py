"""Covariance of a tracked view: from its patch, times a common factor learnt from the residuals.

Least-squares alignment under grey-level noise of deviation σ has covariance σ² c H⁻¹, eq. (13), with H the sum of
gradient products over the window (Förstner and Gülch 1987) and c the number of pixels that share one noise value
after smoothing. What the patch cannot know (perspective, interpolation, the lens model) enters as a floor and as one
factor for all views.
"""

from dataclasses import replace

import numpy as np

from ..geometry.medians import MEMORY_FRAMES
from ..geometry.se3 import Array
from ..record import record

# σ₀ of eq. (15), chosen by hand: the error that interpolation and rectification tables leave even in a perfect match.
_FLOOR_PX = 0.03
# s of eq. (17), for the part of the motion across the line of sight and along it. A change of direction shears a
# patch, which its slope mostly describes; a change of distance also changes its detail and what is beside it. With 0.3
# for both the mean NEES of the pose, 6 expected, is 1.8 driving sideways and 12 to 15 driving forward; with these 2.3
# and 7 to 11. Smaller ones make poses more accurate and claim too much.
_ACROSS, _ALONG = 0.2, 0.42
# Bounds of the factor: beyond them, from a fifth of the σ expected to five times it, something else is wrong.
_FACTOR_RANGE = (0.05, 30.0)
_MIN_DOF = 20  # of a frame that the factor learns from; with fewer, χ²/dof scatters by a third or more
_TYPICAL_STD_PX = 0.15  # of a view before the factor: about what views of a rendered wall scatter by
_REDUCTION_PX = 0.6  # σ of the smoothing that halving twice leaves, in pixels of the reduced image
_MIN_ERROR_GREY = 0.5  # rounding to whole grey values alone leaves 0.4 between two images
_UNKNOWN_ERROR_GREY = 255.0  # of a side that was not found: its covariance is large, and counts for nothing
# Added to the gradient matrix, relative to its trace and absolutely (grey²): along an edge the σ of a position
# stays within 32 times the σ across it, and that of a patch without texture finite.
_DAMPING, _MIN_GRADIENT = 1e-3, 1e-6


@record
class ViewNoise:
    """Covariances of views by templates of half width `radius_px` image pixels, whose pixels are `scale` of them wide.

    `shared_pixels`: how many pixels share one noise value after smoothing; `factor`: the variance factor learnt over
    so many `frames`, 1 before anything is known.
    """

    scale: int
    radius_px: int
    shared_pixels: float
    factor: float = 1.0
    frames: int = 0

    @classmethod
    def unknown(cls, smoothing_px: float, radius_px: int, scale: int = 1) -> "ViewNoise":
        """Return the noise before any frame; `radius_px` in pixels of the templates."""
        smoothing_px = smoothing_px if scale == 1 else _REDUCTION_PX
        return cls(scale, scale * radius_px, max(1.0, 4 * np.pi * smoothing_px**2))

    def covariance(self, gradients: Array, error_left: Array, error_right: Array) -> Array:
        """Covariances (n, 4, 4) px² of views, eq. (15).

        From the gradient matrices (n, 2, 2) of today's templates and the deviations (n,) of grey differences.
        """
        trace = np.trace(gradients, axis1=1, axis2=2)[:, None, None]
        h = gradients + (_DAMPING * trace + _MIN_GRADIENT) * np.eye(2)
        shape = np.linalg.inv(h)
        cov = np.zeros((len(gradients), 4, 4))
        for side, error in ((slice(0, 2), error_left), (slice(2, 4), error_right)):
            grey = np.where(np.isfinite(error), error, _UNKNOWN_ERROR_GREY)
            # a mean over pixels is rounded by so much less; half of the variance is the template's
            variance = 0.5 * self.shared_pixels * np.maximum(grey, _MIN_ERROR_GREY / self.scale) ** 2
            cov[:, side, side] = self.factor * (variance[:, None, None] * shape + _FLOOR_PX**2 * np.eye(2))
        return self.scale**2 * cov

    def drift(self, points: Array, cam_from_previous: Array) -> Array:
        """Standard deviation (n,) px of how far templates slid since the last frame, eq. (17); points (n, 4).

        The warp knows pose and depth, not all of the surface: a change of viewing direction or distance by |t|/Z
        changes the patch by as much, and a part of that passes for motion of the point.
        """
        t = cam_from_previous[:3, 3]
        rays = points[:, :3] / np.linalg.norm(points[:, :3], axis=1)[:, None]
        along = rays @ t
        across = np.sqrt(np.maximum(t @ t - along**2, 0.0))
        return np.asarray(self.radius_px * points[:, 3].clip(0) * np.hypot(_ACROSS * across, _ALONG * along))

    def learnt(self, chi2: float, dof: int) -> "ViewNoise":
        """Return the noise after a frame whose accepted views have these squared residuals, eq. (16)."""
        if dof < _MIN_DOF:
            return self
        frames = self.frames + 1
        gain = 1 / min(frames + 1, MEMORY_FRAMES)
        factor = float(np.clip(self.factor * (1 + gain * (chi2 / dof - 1)), *_FACTOR_RANGE))
        return replace(self, factor=factor, frames=frames)

    def typical_cov(self, n: int) -> Array:
        """Covariances (n, 2, 2) px² of left positions where nothing has been measured yet."""
        return np.tile(self.factor * _TYPICAL_STD_PX**2 * np.eye(2), (n, 1, 1))
