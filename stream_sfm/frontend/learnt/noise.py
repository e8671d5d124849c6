"""The covariance of a tracked view, from its patch and a common factor learnt from the residuals.

Least-squares alignment under grey-level noise of standard deviation σ has covariance σ² c H⁻¹, eq. (13), with H the sum
of gradient products over the window (Förstner and Gülch 1987) and c the number of pixels that share one noise value
after smoothing. Errors that the patch does not show (perspective, interpolation, the lens model) enter as a floor and
as one factor for all views.
"""

import numpy as np

from ...geometry import Array
from ...geometry.medians import MEMORY_FRAMES
from ...record import changed, record
from ..rules import ErrorRules


@record
class ViewNoise:
    """The noise of views by templates of one size.

    `shared_pixels`: how many pixels share one noise value after smoothing; `factor`: the variance factor learnt from
    `frames` frames, 1 before the first.
    """

    shared_pixels: float
    rules: ErrorRules
    factor: float = 1.0
    frames: int = 0

    @classmethod
    def unknown(cls, rules: ErrorRules, smoothing_px: float, scale: int = 1) -> "ViewNoise":
        """Return the noise before any frame, for templates whose pixels are `scale` image pixels wide."""
        smoothing_px = smoothing_px if scale == 1 else 0.6  # two halvings smooth by this, in reduced pixels
        return cls(max(1.0, 4 * np.pi * smoothing_px**2), rules)

    def learnt(self, chi2: float, dof: int) -> "ViewNoise":
        """Return the noise after a frame whose accepted views have squared residuals with the sum `chi2`, eq. (16)."""
        if dof < self.rules.min_dof:
            return self
        frames = self.frames + 1
        gain = 1 / min(frames + 1, MEMORY_FRAMES)
        factor = self.factor * (1 + gain * (chi2 / dof - 1))
        factor = min(max(factor, self.rules.least_factor), self.rules.most_factor)
        return changed(self, factor=factor, frames=frames)

    def typical_cov(self, n: int) -> Array:
        """Return covariances (n, 2, 2) px² of left positions before anything is measured."""
        return np.tile(self.factor * self.rules.typical_std_px**2 * np.eye(2), (n, 1, 1))
