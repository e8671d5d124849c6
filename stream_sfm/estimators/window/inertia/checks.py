"""Checks of inertia: whether its state is possible, how large its noise is, and which errors are exactly zero.

All checks run from the first frame on, eqs. (86) to (87). Whether samples are believed is in `belief.py`.
"""

from itertools import product

import numpy as np

from .... import core
from ....config import RigConfig
from ....geometry import Array, se3
from ....geometry.linear import symmetric
from ....inertial.state import ACCEL_BIAS, AXES, CLOCK, FIXED, GRAVITY, GRAVITY_M_S2, GYRO_BIAS, SCALE, VELOCITY
from ....record import changed, record
from ....types import InertialEstimate
from .interval import JOINT, Known
from .rules import InertiaRules

_SIZES = (1, 3, 1)  # of scale, axes and clock
_THERE = np.array(list(product((0.0, 1.0), repeat=len(_SIZES))))  # which errors are not zero: all combinations
_ROWS = np.repeat(_THERE, _SIZES, axis=1)


def impossible(state: Array, cov: Array, rules: InertiaRules) -> bool:
    """Whether a state (17,) with `cov` (17, 17) is impossible, so that it began with a wrong motion."""
    bias, gravity = state[ACCEL_BIAS], state[GRAVITY]
    if bias @ bias > rules.far_bias * rules.std_accel_bias_m_s2**2 + rules.far_bias * np.trace(
        cov[ACCEL_BIAS, ACCEL_BIAS]
    ):
        return True
    size = np.linalg.norm(gravity)
    variance = rules.std_gravity_m_s2**2 + gravity @ cov[GRAVITY, GRAVITY] @ gravity / size**2
    return bool((size - GRAVITY_M_S2) ** 2 > rules.far_gravity * variance)


@record
class Densities:
    """Factors on the noise densities of gyroscope and accelerometer, and on slides, from their residuals, eq. (86).

    `squares`, `shares` (3,): sums of weighted squared residuals in units of the data sheet, and of their expected
    values. `plain` (3, 2): both without weights, as all weights are small if the noise of the samples is assumed far
    too small. `sheet` (3,): `squares` per share before any residual. `factors` (3,): the resulting factors.
    """

    rules: InertiaRules
    squares: Array
    shares: Array
    plain: Array
    sheet: Array
    factors: Array

    @classmethod
    def of(cls, rules: InertiaRules, squares: Array, shares: Array, plain: Array, sheet: Array) -> "Densities":
        """Return the densities with the factors from these sums."""
        known, at_least = squares / shares, plain[:, 0] / plain[:, 1]
        at_least[2] = 0.0  # of slides: only the gyroscope shows them
        likely = np.where(at_least > 1, np.maximum(known, at_least), known)
        factors = np.clip(np.sqrt(likely), rules.least_factor, rules.most_factor)
        return cls(rules, squares, shares, plain, sheet, factors)

    @property
    def explain_residuals(self) -> bool:
        """Whether the accelerometer errs by no more than its own noise makes credible, as a wrong axis would."""
        return bool(self.factors[1] < self.rules.most_unexplained * np.sqrt(self.sheet[1]))

    @classmethod
    def begun(cls, rules: InertiaRules, noise: Array | None = None) -> "Densities":
        """Return the densities of the data sheet, or larger ones by the `noise` (2,) between neighbouring samples.

        They are never smaller, as IMUs that smooth their samples hide noise from this test.
        """
        sheet = np.ones(3)
        if noise is not None:
            sheet[:2] = np.clip(noise, 1.0, rules.most_factor) ** 2
        counts = np.full(3, rules.data_sheet)
        return cls.of(rules, counts * sheet, counts, np.full((3, 2), rules.little), sheet)

    def after(self, surprise: Array) -> "Densities":
        """Return the densities after an interval with a `surprise` (3, 4), as in `InertialWindow.learn`."""
        keep = 1 - 1 / self.rules.remembered
        counts = (1 - keep) * self.rules.data_sheet
        in_units = self.factors**2  # the units that residuals are weighted with
        squares = keep * self.squares + counts * self.sheet + surprise[:, 0] * in_units
        shares = keep * self.shares + counts + surprise[:, 1]
        plain = keep * self.plain + np.stack([surprise[:, 2] * in_units, surprise[:, 3]], axis=1)
        return Densities.of(self.rules, squares, shares, plain, self.sheet)


@record
class Jitter:
    """Independent errors of the stamps of images, eq. (86a).

    An error of one stamp makes images and samples differ by a time in one interval, and by the opposite time in the
    next. `products`: the sum of the negative products of these times in neighbouring frames, s², less the part from the
    noise of images; `count`: the number of products. `late_s`: the time in the latest frame, with its variance `var_s2`
    from that noise; None if the camera moves too little to measure it.
    """

    rules: InertiaRules
    products: float = 0.0
    count: float = 0.0
    late_s: float | None = None
    var_s2: float = 0.0

    def after(self, late_s: float, var_s2: float) -> "Jitter":
        most_s2 = self.rules.tells_jitter_s**2
        if not var_s2 < most_s2:
            return changed(self, late_s=None)
        if self.late_s is None:
            return changed(self, late_s=late_s, var_s2=var_s2)
        keep = 1 - 1 / self.rules.jitter_frames
        product = min(max(-late_s * self.late_s, -most_s2), most_s2) - 0.5 * min(var_s2, self.var_s2)
        return Jitter(self.rules, keep * self.products + product, keep * self.count + 1, late_s, var_s2)

    @property
    def var_interval(self) -> float:
        """The variance of the time between two stamps, s²."""
        return max(2 * self.products / (self.count + self.rules.data_sheet), 0.0)


@record
class Surprise:
    """How much farther than expected the motions of images have been from those of the samples lately, eq. (85d).

    `mean`: of squared distances over their expected value. A wrong scale or axis that no single frame contradicts
    shows here at once, and in `Densities` only once its intervals leave the window.
    """

    rules: InertiaRules
    mean: float = 1.0

    def after(self, distance2: float) -> "Surprise":
        """Return the record after a frame."""
        ratio = min(distance2, self.rules.apart) / 6
        return changed(self, mean=self.mean + (ratio - self.mean) / self.rules.surprise_frames)

    @property
    def factor(self) -> float:
        """The factor on the variance of an interval: exactly 1 in sound units."""
        return self.mean**2 if self.mean > self.rules.surprising else 1.0


def likely(state: Array, cov: Array, std: Array, rig: RigConfig) -> Array:
    """Return scale, axes and clock (5,), each of which is exactly zero if that is likelier, eq. (87).

    `state` (17,) with `cov` (17, 17) contains them; `std` (5,): their σ before any sample. The odds are those of the
    rig, as temporally correlated view errors look like a wrong scale, axes or clock.
    """
    mean, own = state[FIXED], cov[FIXED, FIXED]
    scaled = own / np.outer(std, std)
    information = np.linalg.inv(scaled + 1e-9 * np.eye(5))
    weighted = information @ (mean / std)
    information = information - np.eye(5)
    values, axes = np.linalg.eigh(0.5 * (information + information.T))
    information = (axes * np.maximum(values, 0.0)) @ axes.T
    log_det, counted = core.solved_by_size(rig.counts * information, weighted[:, None], _ROWS)
    gained = rig.counts**2 * (counted[..., 0] @ weighted)
    log_odds = np.log(rig.odds) * _THERE.sum(axis=1) + 0.5 * (gained - log_det)
    means = core.solved_by_size(information, weighted[:, None], _ROWS)[1][..., 0]
    weights = np.exp(log_odds - log_odds.max())
    weights /= weights.sum()
    probable = 2 - 1 / np.maximum(weights @ _THERE, 0.5)  # zero unless the error is likelier present than absent
    return np.asarray(np.repeat(probable, _SIZES) * (weights @ means) * std)


def with_odds(known: Known, cov: Array, std_fixed: Array, rig: RigConfig) -> Known:
    """Return pose and state at the probable scale, axes and clock, eq. (87).

    `known` is conditional on the rig's errors, which are held; `cov` (23, 23) is not. While these are held, the
    effect on the pose that scale and rig have in common is attributed to the rig, so the pose moves by the
    conditional covariances.
    """
    apart = likely(known.state, cov[JOINT["state"], JOINT["state"]], std_fixed, rig)
    apart -= known.state[FIXED]
    at = JOINT.within("state", FIXED)
    moved = known.cov[:, at] @ np.linalg.solve(known.cov[at, at], apart)
    state = known.state + moved[JOINT["state"]]
    pose = se3.orthonormalise(known.world_from_cam @ se3.exp(moved[JOINT["pose"]]))
    cov = symmetric(cov + np.outer(moved, moved))  # the squared moves of the fixed parameters are added
    return Known(known.stamp_ns, pose, state, cov)


def inertial_estimate(known: Known, factors: Array, std_tilt_rad: float = 0.0) -> InertialEstimate:
    """Return the reported form of a state, whose gravity may also have turned by `std_tilt_rad`, eq. (87a).

    `factors` (2 or more): on the noise densities of gyroscope and accelerometer.
    """
    s, cov = known.state, known.cov.copy()
    turns, at = se3.skew(s[GRAVITY]), JOINT.within("state", GRAVITY)
    cov[at, at] += std_tilt_rad**2 * turns @ turns.T
    return InertialEstimate(
        *(s[VELOCITY], s[GRAVITY], s[GYRO_BIAS], s[ACCEL_BIAS], float(s[SCALE][0]), s[AXES], float(s[CLOCK][0])),
        *(cov, factors[:2]),
    )
