"""What a tracked view is worth: its covariance from the patch, and a common factor learnt from the residuals.

Least-squares alignment under grey-level noise of deviation σ has covariance σ² c H⁻¹, eq. (13), with H the sum of
gradient products over the window (Förstner and Gülch 1987) and c the number of pixels that share one noise value
after smoothing. What the patch cannot know (perspective, interpolation, the lens model) enters as a floor and as one
factor for all views.
"""

import numpy as np

from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection

_FLOOR_PX = 0.03  # interpolation and rectification tables
_SLANT = 0.42  # see ViewNoise.drift
_MEMORY_FRAMES = 20.0
_FACTOR_RANGE = (0.05, 30.0)


class ViewNoise:
    """Covariances of views; `factor` is the learnt variance factor, 1 before anything is known."""

    def __init__(self, smoothing_px: float, radius_px: int) -> None:
        self.shared_pixels = max(1.0, 4 * np.pi * smoothing_px**2)
        self.radius_px = radius_px
        self.factor = 1.0
        self.frames = 0

    def covariance(self, gradients: Array, error_left: Array, error_right: Array) -> Array:
        """(n, 4, 4) px² of views from the gradient matrices (n, 2, 2) of today's templates and the deviations (n,) of
        grey differences, eq. (15)."""
        trace = np.trace(gradients, axis1=1, axis2=2)[:, None, None]
        h = gradients + (1e-3 * trace + 1e-6) * np.eye(2)
        shape = np.linalg.inv(h)
        cov = np.zeros((len(gradients), 4, 4))
        for side, error in ((slice(0, 2), error_left), (slice(2, 4), error_right)):
            grey = np.where(np.isfinite(error), error, 255.0)
            variance = 0.5 * self.shared_pixels * np.maximum(grey, 0.5) ** 2  # half of it is the template's
            cov[:, side, side] = self.factor * (variance[:, None, None] * shape + _FLOOR_PX**2 * np.eye(2))
        return cov

    def drift(self, points: Array, cam_from_previous: Array) -> Array:
        """Standard deviation (n,) px of how far templates slid since the last frame, eq. (17); points (n, 4).

        The warp knows pose and depth, not the surface's slant: a change of viewing direction or distance by an angle
        |t|/Z shears the patch by as much, and a share of that displacement passes for motion of the point.
        """
        return _SLANT * self.radius_px * points[:, 3].clip(0) * np.linalg.norm(cam_from_previous[:3, 3])

    def learn(self, chi2: float, dof: int) -> None:
        """Take the squared residuals of a frame's accepted views into the common factor, eq. (16)."""
        if dof < 20:
            return
        self.frames += 1
        share = 1 / min(self.frames + 1, _MEMORY_FRAMES)
        self.factor = float(np.clip(self.factor * (1 + share * (chi2 / dof - 1)), *_FACTOR_RANGE))

    def var_ray(self, projection: StereoProjection) -> float:
        """Variance of a ray's direction, radians², for a typical view."""
        return self.factor * 0.15**2 / projection.f_px**2
