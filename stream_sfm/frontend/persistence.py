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
from ..geometry.medians import median
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
_MAX_ROW = 3.0  # standard deviations: beyond, a row difference is limited, as it may be a wrong match
_MAX_AGE = 60  # views; by then information grows at a steady rate


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
    ages: NDArray[np.intp] = field(default_factory=lambda: np.empty(0, np.intp))
    rows: Array = field(default_factory=lambda: np.empty(0))

    @property
    def ratio(self) -> float:
        """Variance of the lasting part of errors on the right over that of the white part."""
        of_rows = self.product / self.pairs / _DECAY  # the mean of both sides
        return max(2 * of_rows / (1 + _LEFT_FRACTION), 0.0)

    def after(self, ids: NDArray[np.int64], z_px: Array, cov_px: Array) -> "Persistence":
        """Return the knowledge after a frame's views (n, 4) of tracks `ids` (n,), ascending, with covariances."""
        rows = _whitened_rows(z_px, cov_px)
        old, now = (
            core.among(self.ids, ids),
            core.among(ids, self.ids),
        )  # both ascending: the same tracks in one order
        products = self.rows[old] * rows[now]
        products = products[np.isfinite(products)]
        keep = max(0.0, 1 - len(products) / _MEMORY_PAIRS)
        ages = np.zeros(len(ids), np.intp)
        ages[now] = np.minimum(self.ages[old] + (self.frames % self.every == 0), _MAX_AGE - 1)
        return Persistence(
            every=self.every,
            frames=self.frames + 1,
            product=keep * self.product + float(products.sum()),
            pairs=keep * self.pairs + len(products),
            ids=ids,
            ages=ages,
            rows=rows,
        )

    @property
    def inflation(self) -> Array:
        """By how much (n, 2) the variances of the last views, left and right side, have to be multiplied.

        For an estimator that adds up the views of one track as if they were independent.
        """
        left, right = (inflation_by_age(share * self.ratio, _DECAY**self.every) for share in (_LEFT_FRACTION, 1.0))
        return np.stack([left[self.ages], right[self.ages]], axis=1)


def inflation_by_age(ratio: float, decay: float = _DECAY) -> Array:
    """Return (60,) variances of white noise, in units of the white part, that say as much as the n-th view adds.

    `decay`: of the lasting part from one view to the next.
    """
    return core.inflation_by_age(ratio, decay, _MAX_AGE)


def _whitened_rows(z_px: Array, cov_px: Array) -> Array:
    """Row differences (n,) in standard deviations, without what a whole frame shares; NaN without a right side."""
    difference = z_px[:, 1] - z_px[:, 3]
    seen = np.isfinite(difference)
    if not seen.any():
        return difference
    std = np.sqrt(cov_px[:, 1, 1] + cov_px[:, 3, 3] - 2 * cov_px[:, 1, 3])
    whitened: Array = ((difference - median(difference[seen])) / std).clip(-_MAX_ROW, _MAX_ROW)
    return whitened
