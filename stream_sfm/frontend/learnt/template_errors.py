"""The correlated errors of a point's views: a lasting part in each side, and a shared part that no view averages out.

The lasting part is learnt without ground truth, from the rows: v_left − v_right of a match depends on neither motion
nor depth, so its autocorrelation along the tracks is that of the errors themselves. From it follows how much the n-th
view of a track adds to the information of the earlier ones, eqs. (68), (69). How large the shared part may be is shown
by the distance between the matches of the whole patch and its inner half, eq. (18).
"""

from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...geometry import Array
from ...record import changed, record
from ..rules import ErrorRules

_LAG = 5  # frames over which the decay is measured; most tracks live that long


def turn_of_slides(drift_px: Array, f_px: float, alike: float) -> float:
    """Return σ about each axis, rad, of the apparent turn that a common drift of templates causes, eq. (17a).

    `drift_px` (n,): σ of the drift of each template; `alike`: the share of it that is common to all.
    """
    return alike * float(np.sqrt((drift_px**2).mean())) / f_px if len(drift_px) else 0.0


def _guessed(rules: ErrorRules) -> Array:
    """Return the sums (6,) of `guess_pairs` pairs of row differences with the guessed statistics."""
    white, lasting, decay = rules.first_white, rules.first_lasting, rules.first_decay
    product = lasting * decay
    return rules.guess_pairs * np.array(
        [white + lasting, product, 1, product / 4, product * decay ** (_LAG - 1) / 4, 0.25]
    )


@record
class TemplateErrors:
    """The learnt statistics of lasting errors, the tracks of the latest frame, and σ of the shared error per point.

    `sums` (6,): of squares and products of row differences, as `core.row_errors_of_tracks` returns them. `ids` (n,):
    of the latest tracks, with `ages` (n,) in views and whitened row differences `rows` (n, `_LAG`), the latest first.
    Points `begun` (m,), ascending, have shared disparity errors of σ `stds_px` (m,), others of `least_px`.
    """

    sums: Array = field(default_factory=lambda: _guessed(ErrorRules()))
    ids: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    ages: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    rows: Array = field(default_factory=lambda: np.empty((0, _LAG)))
    begun: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    stds_px: Array = field(default_factory=lambda: np.empty(0))
    least_px: float = ErrorRules().std_shared_px
    rules: ErrorRules = ErrorRules()

    @classmethod
    def begun_by(cls, rules: ErrorRules) -> "TemplateErrors":
        """Return the prior statistics, before any frame."""
        return cls(_guessed(rules), least_px=rules.std_shared_px, rules=rules)

    @property
    def decay(self) -> float:
        """The decay of the lasting part, per frame."""
        product, later = self.sums[3:5]
        ratio = later / product if product > 0 else 0.0
        decay = float(max(ratio, 0.0)) ** (1 / (_LAG - 1))
        return min(max(decay, self.rules.least_decay), self.rules.most_decay)

    @property
    def parts(self) -> tuple[float, float]:
        """The variances of the white part, of both sides, and of the lasting part on the right, over those of views."""
        rules, (all_of_it, product) = self.rules, self.sums[:2] / self.sums[2]
        all_of_it = max(all_of_it, 1.0)  # the variance of views is that of all coordinates, and rows err least
        lasting = min(max(product / self.decay, 0.0), (1 - rules.least_white) * all_of_it)  # the mean of both sides
        return float(all_of_it - lasting), float(2 * lasting / (1 + rules.left_fraction))

    def after(self, ids: NDArray[np.int64], z_px: Array, cov_px: Array) -> "TemplateErrors":
        """Return the statistics after a frame's views (n, 4) of tracks `ids` (n,), ascending, with covariances."""
        ages, rows, sums = core.row_errors_of_tracks(self.ids, self.ages, self.rows, ids, z_px, cov_px, self.rules)
        keep = max(0.0, 1 - sums[2] / self.rules.memory_pairs)
        return changed(self, sums=keep * self.sums + sums, ids=ids, ages=ages, rows=rows)

    @property
    def inflation(self) -> Array:
        """The factors (n, 2) on the variances of the last views, left and right side.

        They are for an estimator that treats the views of one track as independent.
        """
        white, lasting = self.parts
        ratio = lasting / white
        return white * core.view_inflation(self.ages, self.rules.left_fraction * ratio, ratio, self.decay, self.rules)

    def with_new(self, ids: NDArray[np.int64], apart_px: Array) -> "TemplateErrors":
        """Return the same with new points (n,), whose whole patch and inner half were matched `apart_px` (n,) apart."""
        return self.joined(TemplateErrors(self.sums, begun=ids, stds_px=np.hypot(self.least_px, apart_px)))

    def joined(self, later: "TemplateErrors") -> "TemplateErrors":
        """Return the same with the points of a later one added."""
        latest = slice(-self.rules.remembered_points, None)
        begun = np.concatenate([self.begun, later.begun])[latest]
        return changed(self, begun=begun, stds_px=np.concatenate([self.stds_px, later.stds_px])[latest])

    def std_disparity_px(self, ids: NDArray[np.int64]) -> Array:
        """Return σ (n,) px of the disparity error that all views of a point share, for live or ended points (n,)."""
        if not len(self.begun):
            return np.full(len(ids), self.least_px)
        at = np.minimum(np.searchsorted(self.begun, ids), len(self.begun) - 1)
        return np.where(self.begun[at] == ids, self.stds_px[at], self.least_px)
