"""What the calibration leaves of row differences between left and right, learnt from the matches of a run.

After rectification a point lies on one row in both images. Real calibrations miss that by tenths of a pixel, smoothly
over the image: the cameras' relative rotation, and lenses that the distortion model does not describe quite. Matches
measure it directly. The difference is a polynomial of second order in the left image, eq. (19), estimated by
recursive robust least squares from newly matched points (a point's later views repeat its first error) with a prior
at zero.
"""

import numpy as np

from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection

_PRIOR_STD_PX = 1.0
_STD_MATCH_PX = 0.2  # of one match, before any is seen
_MEMORY_FRAMES = 20.0
_CAUCHY = 2.4
_GATE = 4.0  # in standard deviations
_LEAST_GATE_PX = 0.3


class RowAlignment:
    """`difference(left_px)`: v_left − v_right that a correct match shows, px."""

    def __init__(self, projection: StereoProjection) -> None:
        self._centre = np.array([(projection.width - 1) / 2, (projection.height - 1) / 2])
        self._half = self._centre.max()
        self._information = np.eye(6) / _PRIOR_STD_PX**2
        self._right = np.zeros(6)
        self._coefficients: Array = np.zeros(6)
        self._std_px = _STD_MATCH_PX
        self._frames = 0

    @property
    def gate_px(self) -> float:
        """Largest deviation from `difference` of a match to be believed."""
        return max(_GATE * self._std_px, _LEAST_GATE_PX)

    def difference(self, left_px: Array) -> Array:
        """(n,) at left positions (n, 2)."""
        return self._terms(left_px) @ self._coefficients

    def learn(self, left_px: Array, difference_px: Array) -> None:
        """Take in matches at (n, 2) whose rows differ by (n,)."""
        if len(left_px) < 6:
            return
        terms = self._terms(left_px)
        coefficients: Array = self._coefficients
        for _ in range(5):  # of the robust weights; what earlier frames said stays as it is
            residual = (difference_px - terms @ coefficients) / self._std_px
            weight = 1 / (1 + (residual / _CAUCHY) ** 2) / self._std_px**2
            information = self._information + (terms.T * weight) @ terms
            right = self._right + (terms.T * weight) @ difference_px
            coefficients = np.asarray(np.linalg.solve(information, right))
        self._information, self._right, self._coefficients = information, right, coefficients
        self._frames += 1
        scatter = 1.4826 * float(np.median(np.abs(difference_px - terms @ coefficients)))
        self._std_px += (scatter - self._std_px) / min(self._frames, _MEMORY_FRAMES)

    def _terms(self, left_px: Array) -> Array:
        x, y = ((left_px - self._centre) / self._half).T
        return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
