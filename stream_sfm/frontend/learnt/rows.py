"""Row differences: how v_left − v_right of correct matches varies over the image, learnt from the matches, eq. (19).

After rectification a point lies on the same row in both images. Real calibrations miss this by tenths of a pixel. Row
differences depend on neither depth nor motion, so one linear Gaussian filter estimates a polynomial, a smooth field and
the delay of the right camera. Only new matches count, because later views of a point repeat its first error.
"""

import math
from typing import Annotated

import numpy as np

from ... import core
from ...config import Config
from ...config.section import Section, expert
from ...geometry import Array
from ...geometry.linear import symmetric_inverse
from ...geometry.medians import CAUCHY_WIDTH, MAD_TO_STD, MEMORY_FRAMES, median
from ...geometry.stereo import StereoProjection, places_over_image, velocities
from ...record import changed, record
from ...rig_model.field import LEAST_PX, Field, field_over


class RowRules(Section, frozen=True, kw_only=True):
    """How row differences of left and right are learnt."""

    # Real calibrations were wrong by up to 0.8 px in the corners.
    std_px: Annotated[float, expert("prior σ of each coefficient of the row difference, px", 1e-3, 100)] = 1.0
    # Lenses that warm up move rows by a pixel in some hundred frames.
    step_px: Annotated[float, expert("σ of the change of a coefficient per frame, px", 0, 10)] = 2e-3
    # Within a few frames the scatter of the matches replaces it.
    std_match_px: Annotated[float, expert("σ of one match before any is seen, px", 1e-3, 100)] = 0.2
    # After that, Cauchy weights hardly change.
    reweightings: Annotated[int, expert("reweightings of one frame's matches", 1, 100)] = 5
    # One good match in 16 000 is lost.
    gate_sigmas: Annotated[float, expert("largest distance of a match from its row, σ", 0.1, 1000)] = 4.0
    # This is three times the scatter of good matches. With less, a few matches that agree by chance would set the
    # gate.
    least_gate_px: Annotated[float, expert("least gate of a match about its row, px", 1e-3, 100)] = 0.3
    # This is well below the errors that matter.
    known_px: Annotated[float, expert("σ below which a row difference is known, px", 1e-3, 100)] = 0.1


_POLYNOMIAL = 6  # coefficients
# Candidates for σ of the field, px, from the noise of a good match to more than any real rig has. In addition σ = 0 is
# considered, as probable as all of them together.
_FIELD_STD_PX = np.geomspace(0.01, 0.5, 18)


@record
class Rows:
    """The estimated row differences: amplitudes `mean` (n,) with `cov` (n, n) of polynomial, delay and field.

    `std_delay_s`: prior σ of the delay. `scatter_px`: σ of new matches around the model; `unexplained_px`: the same but
    for what an unknown turn of the camera during the delay explains; `frames`: how many frames both are learnt from.
    `field_std_px`: σ of the field. `largest_px`: the largest v_left − v_right at rest at the latest matches; in corners
    without matches the polynomial is an extrapolation.
    """

    projection: StereoProjection
    max_px: float
    mean: Array
    cov: Array
    std_delay_s: float
    rules: RowRules
    scatter_px: float
    unexplained_px: float
    frames: int = 0
    field_std_px: float = LEAST_PX
    largest_px: float = 0.0

    @classmethod
    def unknown(cls, projection: StereoProjection, config: Config) -> "Rows":
        rules = config.rules.of(RowRules)
        std_delay_s = 1e-9 if config.rig.exact else config.rig.std_delay_s
        n_field = field_over(projection.width, projection.height).size
        std = np.r_[np.full(_POLYNOMIAL, rules.std_px), std_delay_s, np.full(n_field, LEAST_PX)]
        max_px = config.frontend.max_vertical_disparity_px
        prior = np.zeros(len(std)), np.diag(std**2), std_delay_s
        return cls(projection, max_px, *prior, rules, rules.std_match_px, rules.std_match_px)

    @property
    def delay(self) -> tuple[float, float]:
        """The delay of the right camera from matches alone: its information, s⁻², and information times delay, s⁻¹."""
        mean, var = self.mean[_POLYNOMIAL], self.cov[_POLYNOMIAL, _POLYNOMIAL]
        return float(1 / var - self.std_delay_s**-2), float(mean / var)

    def with_delay(self, delay_s: float, variance_s2: float) -> "Rows":
        """Return the rows with a delay N(`delay_s`, `variance_s2`), if that is more certain than their own estimate.

        Learning continues without it: estimators receive the delay through `delay`, and must not receive it twice.
        """
        own = self.cov[_POLYNOMIAL]
        if variance_s2 * (self.delay[0] + self.std_delay_s**-2) >= 1:
            return self
        gain = own / own[_POLYNOMIAL]
        mean = self.mean + gain * (delay_s - self.mean[_POLYNOMIAL])
        return changed(self, mean=mean, cov=self.cov + np.outer(gain, gain) * (variance_s2 - own[_POLYNOMIAL]))

    @property
    def field(self) -> Field:
        """The field over the images; its amplitudes are the last ones."""
        return field_over(self.projection.width, self.projection.height)

    def over_image(self, down: int, across: int) -> tuple[Array, Array]:
        """Return v_left − v_right at rest at `down` × `across` places of the left image, and its σ; px, row by row."""
        places_px = places_over_image(self.projection, down, across)
        terms = row_terms(self.projection, places_px, np.zeros(len(places_px)))
        return terms @ self.mean, np.sqrt(np.einsum("ni,ij,nj->n", terms, self.cov, terms))

    @property
    def rms_px(self) -> float:
        """v_left − v_right at rest, root mean square over the places where it is known; NaN without any."""
        difference_px, std_px = self.over_image(9, 9)
        known = std_px < self.rules.known_px
        return float(np.sqrt((difference_px[known] ** 2).mean())) if known.any() else float("nan")

    def of_matches(self, cov_px: Array) -> Array:
        """Return the covariances (n, 4, 4) of new matches, whose rows err as those of this run do, eq. (19c)."""
        if not self.frames or not len(cov_px):
            return cov_px
        beyond_px2 = self.unexplained_px**2 - median(cov_px[:, 1, 1] + cov_px[:, 3, 3])
        return cov_px + np.diag([0, 0, 0, max(beyond_px2, 0.0)])

    def after(self, z_px: Array, twist: Array, std_turning_rad_s: float) -> "Rows":
        """Return the rows after new views (n, 4) of a frame whose points move with a twist (6,).

        The twist is an extrapolation, and its rotation errs by `std_turning_rad_s` about each axis. During a delay this
        moves all rows of the frame, so that it is an unknown of the frame, eq. (19b).
        """
        points = core.seen_points(self.projection, z_px)
        row_speed_px_s = velocities(self.projection, points, twist)[:, 3]
        by_turning = np.stack([velocities(self.projection, points, e)[:, 3] for e in np.eye(6)[3:]], axis=1)
        size_s = math.hypot(self.mean[_POLYNOMIAL], math.sqrt(self.cov[_POLYNOMIAL, _POLYNOMIAL]))
        own_px = by_turning * (size_s * std_turning_rad_s)
        return self.learnt(z_px[:, :2], z_px[:, 1] - z_px[:, 3], row_speed_px_s, own_px)

    def learnt(
        self, left_px: Array, difference_px: Array, row_speed_px_s: Array, own_px: Array | None = None
    ) -> "Rows":
        """Return the rows after matches at (n, 2), whose rows differ by (n,) and move by (n,) px/s.

        `own_px` (n, e): the effects of errors of this frame alone, of σ = 1.
        """
        if len(left_px) < _POLYNOMIAL:
            return self
        matches, rules = (left_px, difference_px, row_speed_px_s), self.rules
        own_px = np.zeros((len(left_px), 0)) if own_px is None else own_px
        information, weighted, mean, rest_px, without_own_px = core.fit_rows(
            self, *matches, own_px, rules.step_px, CAUCHY_WIDTH, rules.reweightings
        )
        frames = self.frames + 1
        scatter = MAD_TO_STD * median(np.abs(rest_px))
        scatter_px = self.scatter_px + (scatter - self.scatter_px) / min(frames, MEMORY_FRAMES)
        unexplained = MAD_TO_STD * median(np.abs(without_own_px))
        unexplained_px = self.unexplained_px + (unexplained - self.unexplained_px) / min(frames, MEMORY_FRAMES)
        field_std_px = self._likely_field_std_px(information, mean)
        field = range(_POLYNOMIAL + 1, len(mean))
        information[field, field] += field_std_px**-2 - self.field_std_px**-2
        cov = symmetric_inverse(information)
        mean, terms = cov @ weighted, row_terms(self.projection, left_px, row_speed_px_s)
        return changed(
            self,
            mean=mean,
            cov=cov,
            scatter_px=scatter_px,
            unexplained_px=unexplained_px,
            frames=frames,
            field_std_px=field_std_px,
            largest_px=float(np.abs(terms @ mean - terms[:, _POLYNOMIAL] * mean[_POLYNOMIAL]).max()),
        )

    def _likely_field_std_px(self, information: Array, mean: Array) -> float:
        """Return the likely σ of the field, eq. (19a), from all information about the rows."""
        other, field = slice(_POLYNOMIAL + 1), slice(_POLYNOMIAL + 1, None)
        across = information[other, field]
        own = information[field, field] - across.T @ np.linalg.solve(information[other, other], across)
        values, axes = np.linalg.eigh(own - np.eye(len(own)) / self.field_std_px**2)
        weighted = axes.T @ (own @ mean[field])
        evidence = core.log_evidence(np.maximum(values, 0.0), weighted, _FIELD_STD_PX**2).sum(axis=1)
        largest = max(0.0, float(evidence.max()))
        weight = np.exp(evidence - largest) / len(_FIELD_STD_PX)
        std_px = np.sqrt(weight @ _FIELD_STD_PX**2 / (weight.sum() + np.exp(-largest)))
        return max(float(std_px), LEAST_PX)


def row_terms(projection: StereoProjection, left_px: Array, row_speed_px_s: Array) -> Array:
    """Return the effect (n, k) of amplitudes of 1 on v_left − v_right of views at (n, 2), which move by (n,) px/s."""
    field = field_over(projection.width, projection.height)
    return core.row_terms(projection, field, left_px, row_speed_px_s)
