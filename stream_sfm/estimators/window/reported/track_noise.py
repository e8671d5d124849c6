"""Differences of the noise between tracks, measured during the run, and the weights that follow from them, eq. (69c).

The covariance of a view follows from its patch, times a factor measured from all views of the run. Some tracks still
have larger errors and some smaller ones: patches on surfaces that are not planar, on reflections, at edges of shadows.
The residuals of a track show its noise, the better the more views it has. So the variance of each track lies between
that of its residuals and that of all tracks. The more the tracks of this run differ, the nearer it is to the former.
"""

import numpy as np
from numpy.typing import NDArray

from ....geometry import Array
from ....record import record
from .rules import ReportedRules


@record
class TrackNoise:
    """The noise of tracks according to their residuals so far: its mean, and its spread between tracks.

    `sums` (4,): of squared residuals D, of their numbers N, of (D/s − N)² − 2N and of N² + 2N, with s the mean of D per
    value. The variance of a track is s λ, with λ of mean 1 and variance `spread`.
    """

    sums: Array
    rules: ReportedRules = ReportedRules()

    @classmethod
    def unknown(cls, rules: ReportedRules) -> "TrackNoise":
        """Return the first guess: all tracks have the noise of their covariances."""
        n = 5 * 4.0  # values of a track of five stereo views
        return cls(rules.tracks_guess * np.array([n, n, 0.0, n**2 + 2 * n]), rules)

    @property
    def mean(self) -> float:
        """The mean s of a squared residual."""
        return float(self.sums[0] / self.sums[1])

    @property
    def spread(self) -> float:
        """The variance of λ."""
        return max(float(self.sums[2] / self.sums[3]), 0.0)

    def information(self, squares: Array, values: Array, known: NDArray[np.bool_]) -> Array:
        """Return the factors (P,) on the information of the views of tracks, with a mean of 1 over all views.

        `squares` and `values` (P,): sums D and numbers of squared residuals; `known` (P,): points of the prior. The
        factor is 1/λ at the expected λ given D, with a gamma distribution of 1/λ.
        """
        spread, free = self.spread, _free(values, known)
        result = (2 + 2 * spread + spread * free) / (2 + 2 * spread + spread * squares / self.mean)
        total = (result * values).sum()
        return np.asarray(result * (values.sum() / total)) if total > 0 else np.ones(len(result))

    def after(self, squares: Array, values: Array, known: NDArray[np.bool_]) -> "TrackNoise":
        """Return the noise after the tracks of a window; arguments as in `information`."""
        free = _free(values, known)
        informative = free > 0
        n, s = free[informative], self.mean
        d = np.minimum(squares[informative], self.rules.tracks_most * s * n)
        kept = max(0.0, 1 - len(n) / self.rules.tracks_memory) * self.sums
        new = [d.sum(), n.sum(), ((d / s - n) ** 2 - 2 * n).sum(), (n**2 + 2 * n).sum()]
        return TrackNoise(kept + new, self.rules)


def _free(values: Array, known: NDArray[np.bool_]) -> Array:
    """Return the degrees of freedom (P,) of tracks: a point that the prior does not know takes three values."""
    return np.maximum(values - np.where(known, 0, 3), 0.0)
