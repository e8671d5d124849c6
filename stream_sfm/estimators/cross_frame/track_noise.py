"""How much the noise of tracks differs, measured in this run, and what a track's views therefore count, eq. (69c).

The covariance of a view follows from its patch, times a factor that all views of the run have shown. Some tracks still
err by more than that and some by less: patches on things that are not planes, on reflections, at edges of shadows. How
much a track errs shows in its own residuals, and the more views it has, the better. So the variance of each track lies
between what its residuals say and what all tracks have. The more the tracks of this run differ, the nearer it is to the
former.
"""

import numpy as np
from numpy.typing import NDArray

from ...config import WindowConfig
from ...geometry import Array
from ...record import record


@record
class TrackNoise:
    """What residuals of the tracks so far say of their noise: its mean, and how much it differs.

    `sums` (4,): of squared residuals D and of their numbers N; of (D/s − N)² − 2N and of N² + 2N, with s the mean of D
    per value. The variance of a track is s λ, with λ of mean 1 and variance `spread`.
    """

    sums: Array
    rules: WindowConfig = WindowConfig()

    @classmethod
    def unknown(cls, rules: WindowConfig) -> "TrackNoise":
        """Return the first guess: all tracks are alike, as their covariances say."""
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
        """Return by how much (P,) the information of the views of tracks has to be multiplied, 1 in the mean of views.

        `squares` and `values` (P,): sums D and numbers of squared residuals; `known` (P,): points of the prior. It is
        1/λ at the expected λ of a gamma distribution of 1/λ, given D.
        """
        spread, free = self.spread, _free(values, known)
        result = (2 + 2 * spread + spread * free) / (2 + 2 * spread + spread * squares / self.mean)
        total = (result * values).sum()
        return np.asarray(result * (values.sum() / total)) if total > 0 else np.ones(len(result))

    def after(self, squares: Array, values: Array, known: NDArray[np.bool_]) -> "TrackNoise":
        """Return the knowledge after the tracks of a window, as in `information`."""
        free = _free(values, known)
        tells = free > 0
        n, s = free[tells], self.mean
        d = np.minimum(squares[tells], self.rules.tracks_most * s * n)
        kept = max(0.0, 1 - len(n) / self.rules.tracks_memory) * self.sums
        new = [d.sum(), n.sum(), ((d / s - n) ** 2 - 2 * n).sum(), (n**2 + 2 * n).sum()]
        return TrackNoise(kept + new, self.rules)


def _free(values: Array, known: NDArray[np.bool_]) -> Array:
    """Return how many values (P,) of tracks are left once their points are determined, by three each."""
    return np.maximum(values - np.where(known, 0, 3), 0.0)
