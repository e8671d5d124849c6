"""What a tracked view is worth: its covariance from the patch, and a common factor learnt from the residuals.

Least-squares alignment under grey-level noise of deviation σ has covariance σ² c H⁻¹, eq. (13), with H the sum of
gradient products over the window (Förstner and Gülch 1987) and c the number of pixels that share one noise value
after smoothing. What the patch cannot know (perspective, interpolation, the lens model) enters as a floor and as one
factor for all views.
"""

import numpy as np

from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection

# σ₀ of eq. (15), chosen by hand: what interpolation and rectification tables leave even of a perfect match.
_FLOOR_PX = 0.03
# s of eq. (17), learnt anew with projective warps and with errors that last counted apart, which a larger one covered.
# Down to 0.2 the ATE of rendered logs falls (room .46, .39, .34 mm at 0.42, 0.3, 0.2) and the mean NEES of the pose,
# 6 expected, rises (lab_forward 7, 12, 17).
_SLANT = 0.3
_MEMORY_FRAMES = 20.0  # over which the factor is learnt, chosen by hand: a second at 20 frames per second
# Bounds of the factor: beyond them, from a fifth of the σ expected to five times it, something else is wrong.
_FACTOR_RANGE = (0.05, 30.0)
_MIN_DOF = 20  # of a frame that the factor learns from; with fewer χ²/dof scatters by a third and more
_TYPICAL_STD_PX = 0.15  # of a view before the factor: about what views of a rendered wall scatter by
_REDUCTION_PX = 0.6  # σ of the smoothing that halving twice leaves, in pixels of the reduced image
_MIN_ERROR_GREY = 0.5  # rounding to whole grey values alone leaves 0.4 between two images
_UNKNOWN_ERROR_GREY = 255.0  # of a side that was not found: its covariance is large, and counts for nothing
# Added to the gradient matrix, relative to its trace and absolutely (grey²): along an edge the σ of a position
# stays within 32 times the σ across it, and that of a patch without texture finite.
_DAMPING, _MIN_GRADIENT = 1e-3, 1e-6


class ViewNoise:
    """Covariances of views; `factor` is the learnt variance factor, 1 before anything is known."""

    def __init__(self, smoothing_px: float, radius_px: int, scale: int = 1) -> None:
        """Templates of half width `radius_px`, in pixels that are `scale` image pixels wide."""
        self.scale = scale
        smoothing_px = smoothing_px if scale == 1 else _REDUCTION_PX
        self.shared_pixels = max(1.0, 4 * np.pi * smoothing_px**2)
        self.min_error_grey = _MIN_ERROR_GREY / scale  # a mean over pixels is rounded by so much less
        self.radius_px = scale * radius_px
        self.factor = 1.0
        self.frames = 0

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
            variance = (
                0.5 * self.shared_pixels * np.maximum(grey, self.min_error_grey) ** 2
            )  # half of it is the template's
            cov[:, side, side] = self.factor * (variance[:, None, None] * shape + _FLOOR_PX**2 * np.eye(2))
        return self.scale**2 * cov

    def drift(self, points: Array, cam_from_previous: Array) -> Array:
        """Standard deviation (n,) px of how far templates slid since the last frame, eq. (17); points (n, 4).

        The warp knows pose and depth, not the surface's slant: a change of viewing direction or distance by an angle
        |t|/Z shears the patch by as much, and a part of that displacement passes for motion of the point.
        """
        return _SLANT * self.radius_px * points[:, 3].clip(0) * np.linalg.norm(cam_from_previous[:3, 3])

    def learn(self, chi2: float, dof: int) -> None:
        """Update the common factor by the squared residuals of a frame's accepted views, eq. (16)."""
        if dof < _MIN_DOF:
            return
        self.frames += 1
        gain = 1 / min(self.frames + 1, _MEMORY_FRAMES)
        self.factor = float(np.clip(self.factor * (1 + gain * (chi2 / dof - 1)), *_FACTOR_RANGE))

    def var_ray(self, projection: StereoProjection) -> float:
        """Variance of a ray's direction, radians², for a typical view."""
        return self.factor * _TYPICAL_STD_PX**2 / projection.f_px**2
