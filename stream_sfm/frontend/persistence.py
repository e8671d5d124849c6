"""How long the errors of a track persist, and so how much information each further view of it adds.

A template errs against its image in the same way for many frames: the other camera's sharpness, a surface that is not a
plane, the grid of a compressed image. An estimator that adds views up as if their errors were independent becomes
overconfident. How long errors last can be measured without ground truth, from the rows: v_left − v_right of a match
depends on neither motion nor depth, so its autocorrelation along the tracks is that of the errors themselves.

Each error is modelled as white noise of the claimed covariance plus a Gauss-Markov part of variance `ratio` times
that, which decays by `_DECAY` per frame. From the model follows what the n-th view of a track adds to what the ones
before it have said, eqs. (68) and (69).
"""

from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry.se3 import Array
from ..record import record

# Autocorrelation of row differences over 1 to 20 frames of four real and five rendered logs falls by 0.88 to 0.98 per
# frame (`python -m tools.track_errors LOG...`).
_DECAY = 0.92
# Of the left side: its template is of the same camera, so that only what has changed since the first view errs. With a
# quarter estimates from halves of the tracks agree as well as they claim, on rendered and on real logs alike.
_LEFT_FRACTION = 0.25
_FIRST_GUESS = 0.3  # of the mean of both sides: rendered logs have 0.2 to 0.6, real ones 0.6 to 1.3
_GUESS_PAIRS = 200.0  # weight of the first guess in pairs of views: about one frame's
_MEMORY_PAIRS = 20_000.0  # a hundred frames: the ratio is a property of cameras and scene and changes slowly


@record
class Persistence:
    """The estimated ratio of persistent to white variance, and the tracks of the latest frame.

    `every`: of how many frames an estimator takes one; only the views of that one count. `frames` so far; `product` and
    `pairs`: sum of products of row differences of one track in consecutive frames, and of how many. `ids` (n,), with
    `ages` (n,) in views and whitened `rows` (n,).
    """

    every: int = 1
    frames: int = 0
    product: float = _FIRST_GUESS * _DECAY * _GUESS_PAIRS
    pairs: float = _GUESS_PAIRS
    ids: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    ages: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    rows: Array = field(default_factory=lambda: np.empty(0))

    @property
    def ratio(self) -> float:
        """Variance of the lasting part of errors on the right over that of the white part."""
        of_rows = self.product / self.pairs / _DECAY  # the mean of both sides
        return max(2 * of_rows / (1 + _LEFT_FRACTION), 0.0)

    def after(self, ids: NDArray[np.int64], z_px: Array, cov_px: Array) -> "Persistence":
        """Return the knowledge after a frame's views (n, 4) of tracks `ids` (n,), ascending, with covariances."""
        ages, rows, product, pairs = core.row_errors_of_tracks(
            self.ids, self.ages, self.rows, ids, z_px, cov_px, self.frames % self.every == 0
        )
        keep = max(0.0, 1 - pairs / _MEMORY_PAIRS)
        return Persistence(
            every=self.every,
            frames=self.frames + 1,
            product=keep * self.product + product,
            pairs=keep * self.pairs + pairs,
            ids=ids,
            ages=ages,
            rows=rows,
        )

    @property
    def inflation(self) -> Array:
        """By how much (n, 2) the variances of the last views, left and right side, have to be multiplied.

        For an estimator that adds up the views of one track as if they were independent.
        """
        return core.view_inflation(self.ages, _LEFT_FRACTION * self.ratio, self.ratio, _DECAY**self.every)
