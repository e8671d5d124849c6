"""What an error of the calibration does to a view: a smooth field of disparity, and a radial error of both lenses.

Relative rotation, principal points, focal lengths and distortion of the two cameras err together; what they do to the
disparity is a polynomial of the place in the image, eq. (70). Rows err too, and are corrected as they are measured
(`vertical_disparity.py`): they depend on nothing else. The baseline is no part of it: if it is wrong, everything is too
large or too small, and no view shows it.
"""

import numpy as np

from ..camera.refinement import Refinement
from ..config import RigConfig
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from ..types import RigEstimate


class RigEffects:
    """Effects of the possible errors; none where the calibration is exact.

    A `refinement` of the calibration is taken out of the views; its covariance is then what is not known.
    """

    def __init__(self, projection: StereoProjection, config: RigConfig, refinement: Refinement | None) -> None:
        self._projection = p = projection
        self._error_px: Array | None = None if refinement is None else refinement.error_px
        self._root: Array = np.zeros((7, 0))
        if not config.exact:
            cov_px2 = refinement.cov_px2 if refinement is not None else np.diag(prior_std_px(config) ** 2)
            self._root = np.asarray(np.linalg.cholesky(cov_px2), np.float64)
        self._centre = np.array([(p.width - 1) / 2, (p.height - 1) / 2])
        corner = np.hypot(max(p.cx_left_px, p.width - p.cx_left_px), max(p.cy_px, p.height - p.cy_px)) / p.f_px
        self._radial_scale = corner**-3  # 1 px in the corner that is farthest from the lens's middle

    def of(self, z_px: Array) -> Array:
        """(n, 4, m) px per σ of each error, for views (n, 4); zero for a side that was not found."""
        effects: Array = np.nan_to_num(self._per_pixel(z_px)) @ self._root
        return effects

    def corrected(self, z_px: Array) -> Array:
        """Views (n, 4) without the errors that are known."""
        return z_px if self._error_px is None else z_px - self._per_pixel(z_px) @ self._error_px

    def in_px(self, estimate: RigEstimate) -> RigEstimate:
        """An estimate in units of σ as the whole error of the calibration, in pixels."""
        error_px = self._root @ estimate.mean
        if self._error_px is not None:
            error_px = error_px + self._error_px
        return RigEstimate(error_px, self._root @ estimate.cov @ self._root.T, estimate.applied)

    def _per_pixel(self, z_px: Array) -> Array:
        """(n, 4, 7) px per pixel of each term, for views (n, 4)."""
        p = self._projection
        x, y = ((z_px[:, :2] - self._centre) / self._centre).T
        effects = np.zeros((len(z_px), 4, 7))
        effects[:, 2, :6] = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
        rays = (z_px - (p.cx_left_px, p.cy_px, p.cx_right_px, p.cy_px)) / p.f_px
        squared = (rays.reshape(-1, 2, 2) ** 2).sum(axis=2)
        effects[:, :, 6] = rays * np.repeat(squared, 2, axis=1) * self._radial_scale
        return effects


def prior_std_px(config: RigConfig) -> Array:
    """σ (7,) of each term of a calibration that nothing more is known about."""
    return np.array([config.std_disparity_px] * 6 + [config.std_radial_px])
