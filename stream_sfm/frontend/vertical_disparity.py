"""Vertical disparity: what the calibration leaves of row differences between left and right, learnt from matches.

After rectification a point lies on one row in both images. Real calibrations miss that by tenths of a pixel, smoothly
over the image: the cameras' relative rotation, and lenses that the distortion model does not describe quite. Matches
measure it directly. The difference is a polynomial of second order in the left image, eq. (19), estimated by
recursive robust least squares from newly matched points (a point's later views repeat its first error) with a prior
at zero.
"""

import numpy as np
from numpy.typing import NDArray

from ..geometry.medians import median
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection

_PRIOR_STD_PX = 1.0  # of each coefficient: real calibrations were off by up to 0.8 px in the corners
_STD_MATCH_PX = 0.2  # of one match, before any is seen; within a few frames their own scatter replaces it
_MEMORY_FRAMES = 20.0  # over which that scatter is averaged, chosen by hand: a second at 20 frames per second
_CAUCHY = 2.4  # width of the robust weights in standard deviations: 95 % efficiency on Gaussian noise
_REWEIGHTINGS = 5  # of one frame's matches; Cauchy weights hardly change after that
_GATE = 4.0  # standard deviations that a match may be off: one good match in 16 000 is lost
# Three times the scatter of good matches; below, few matches that agree by chance set the gate.
_LEAST_GATE_PX = 0.3
_MAD_TO_STD = 1.4826  # closed form: median absolute deviation to σ of a Gaussian


class VerticalDisparity:
    """Learns v_left − v_right of correct matches; `max_px`: no match is accepted that is further off."""

    def __init__(self, projection: StereoProjection, max_px: float) -> None:
        self._max_px = max_px
        self._centre = np.array([(projection.width - 1) / 2, (projection.height - 1) / 2])
        self._half = self._centre.max()
        x, y = np.meshgrid(np.linspace(0, 2, 5), np.linspace(0, 2, 5))
        self._grid = np.stack([x.ravel(), y.ravel()], axis=1) * self._centre
        self._information = np.eye(6) / _PRIOR_STD_PX**2
        self._weighted_sum = np.zeros(6)
        self._coefficients: Array = np.zeros(6)
        self._std_px = _STD_MATCH_PX
        self._frames = 0

    @property
    def gate_px(self) -> float:
        """Largest deviation of a match that is accepted."""
        return min(max(_GATE * self._std_px, _LEAST_GATE_PX), self._max_px)

    @property
    def largest_px(self) -> float:
        """The largest v_left − v_right of correct matches anywhere in the image."""
        return float(np.abs(self.at(self._grid)).max())

    @property
    def scatter_px(self) -> float:
        """σ of new matches around `at`, over the last frames."""
        return self._std_px

    def at(self, left_px: Array) -> Array:
        """v_left − v_right (n,) of correct matches at left positions (n, 2), px."""
        return self._terms(left_px) @ self._coefficients

    def agrees(self, left_px: Array, right_px: Array, scale: int = 1) -> NDArray[np.bool_]:
        """Whether left and right positions (n, 2), the right ones corrected by `at`, lie on one row.

        `scale`: the gate is so much wider, for matches of reduced images.
        """
        return np.asarray(np.abs(right_px[:, 1] - left_px[:, 1]) < scale * self.gate_px)

    def learn(self, left_px: Array, difference_px: Array) -> None:
        """Update the polynomial by matches at (n, 2) whose rows differ by (n,)."""
        if len(left_px) < len(self._coefficients):
            return
        terms = self._terms(left_px)
        coefficients: Array = self._coefficients
        for _ in range(_REWEIGHTINGS):  # what earlier frames said keeps its weight
            residual = (difference_px - terms @ coefficients) / self._std_px
            weight = 1 / (1 + (residual / _CAUCHY) ** 2) / self._std_px**2
            information = self._information + (terms.T * weight) @ terms
            weighted_sum = self._weighted_sum + (terms.T * weight) @ difference_px
            coefficients = np.asarray(np.linalg.solve(information, weighted_sum))
        self._information, self._weighted_sum = information, weighted_sum
        self._coefficients = coefficients
        self._frames += 1
        scatter = _MAD_TO_STD * median(np.abs(difference_px - terms @ coefficients))
        self._std_px += (scatter - self._std_px) / min(self._frames, _MEMORY_FRAMES)

    def _terms(self, left_px: Array) -> Array:
        x, y = ((left_px - self._centre) / self._half).T
        return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
