"""What an error of the calibration does to a view: a smooth field of disparity, and a radial error of both lenses.

Relative rotation, principal points, focal lengths and distortion of the two cameras err together; what they do to the
disparity is a polynomial of the place in the image, eq. (70). Rows err too, and are corrected as they are measured
(`vertical_disparity.py`): they depend on nothing else. The baseline is no part of it: if it is wrong, everything is too
large or too small, and no view shows it.
"""

import numpy as np

from ..config import RigConfig
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from ..types import RigEstimate

NAMES = ("1", "x", "y", "x²", "xy", "y²", "radial")


class RigEffects:
    """Effects of the possible errors; none where the calibration is exact."""

    def __init__(self, projection: StereoProjection, config: RigConfig) -> None:
        self.projection = projection
        p = projection
        std = [config.std_disparity_px] * 6 + [config.std_radial_px]
        self.std_px: Array = np.zeros(0) if config.exact else np.array(std)
        self._centre = np.array([(p.width - 1) / 2, (p.height - 1) / 2])
        corner = np.hypot(max(p.cx_left_px, p.width - p.cx_left_px), max(p.cy_px, p.height - p.cy_px)) / p.f_px
        self._radial_scale = corner**-3  # 1 px in the corner that is farthest from the lens's middle

    def __len__(self) -> int:
        return len(self.std_px)

    def of(self, z_px: Array) -> Array:
        """(n, 4, m) px per σ of each error, for views (n, 4); of a side that was not found they mean nothing."""
        n = len(z_px)
        effects = np.zeros((n, 4, len(self)))
        if not len(self) or not n:
            return effects
        x, y = ((z_px[:, :2] - self._centre) / self._centre).T
        effects[:, 2, :6] = np.stack([np.ones(n), x, y, x * x, x * y, y * y], axis=1)
        effects[:, :, 6] = self._radial(z_px)
        scaled: Array = np.nan_to_num(effects * self.std_px)
        return scaled

    def in_px(self, estimate: RigEstimate) -> RigEstimate:
        """Errors in units of their σ, in pixels."""
        return RigEstimate(
            estimate.mean * self.std_px, estimate.cov * np.outer(self.std_px, self.std_px), estimate.applied
        )

    def _radial(self, z_px: Array) -> Array:
        """(n, 4) px of a radial error of both lenses that is 1 px in the corner."""
        p = self.projection
        rays = (z_px - (p.cx_left_px, p.cy_px, p.cx_right_px, p.cy_px)) / p.f_px
        squared = (rays.reshape(-1, 2, 2) ** 2).sum(axis=2)
        radial: Array = rays * np.repeat(squared, 2, axis=1) * self._radial_scale
        return radial
