"""The usual turns of the right camera in a run: real rigs vibrate, or are not quite synchronous."""

import math
from functools import cached_property
from typing import Annotated

import numpy as np

from ...config.section import Section, expert
from ...geometry import Array
from ...geometry.linear import symmetric
from ...geometry.medians import MEMORY_FRAMES
from ...geometry.sizes import SIZES, Sizes
from ...record import changed, record


class TurnRules(Section, frozen=True, kw_only=True):
    """A right camera that is knocked out of alignment."""

    # About one knock per hour at 30 Hz.
    knocks: Annotated[float, expert("prior probability of a knock, per frame", 1e-300, 0.5)] = 1e-5
    # It is 0.01 to 0.05 mrad on rendered logs, and 0.05 to 0.2 mrad on real ones.
    first_guess_rad: Annotated[float, expert("first guess of the usual rotation per frame, rad", 1e-7, 0.1)] = 1e-4
    guess_frames: Annotated[int, expert("weight of the first guess of the usual rotation, frames", 1, 10_000)] = 5
    # This is 3 σ on each axis.
    limit: Annotated[float, expert("cap on χ² of a frame in the usual rotation", 1, 1e6)] = 27.0
    # Three frames fit in one window and keep depths valid.
    lasting_frames: Annotated[int, expert("frames with one rotation before it is accepted", 1, 1000)] = 3
    same: Annotated[float, expert("tolerance of consecutive rotations, relative to their mean", 0, 10)] = 0.5
    # After that, an ever-changing rotation counts as usual.
    patience_frames: Annotated[int, expert("largest number of frames with unusual rotations", 1, 1000)] = 8
    # Templates are not found from farther away; left and right then do not fit each other.
    max_turn_px: Annotated[float, expert("largest rotation that is accepted, px", 0.1, 1000)] = 4.0
    # This is three to four for each of the nine unknowns.
    min_views: Annotated[int, expert("least number of right views that show a rotation", 9, 2000)] = 30
    # If a body covers them, it explains fewer.
    agree: Annotated[float, expert("share of the right views that a rotation must explain", 0, 1)] = 0.6
    gate: Annotated[float, expert("share of good right views that the gate keeps", 0.5, 0.999999999999)] = 0.999
    # After a knock, views are wrong by ten standard deviations or more.
    steps: Annotated[int, expert("largest number of reweighting steps for a rotation", 1, 1000)] = 12
    # The estimator only starts from the measured rotation, so that it is not counted twice.
    std_rad: Annotated[float, expert("prior σ of the rotation by a knock, about each axis, rad", 1e-6, 0.5)] = 3e-3


@record
class ApparentTurns:
    """The apparent turns by unknown errors of the rig in a frame.

    `cov_others` (3, 3): of all but a delay of the right camera, whose turn is `per_s` (3,) rad/s with a variance of
    `var_delay_s2`.
    """

    cov_others: Array
    per_s: Array
    var_delay_s2: float

    @property
    def cov(self) -> Array:
        """The covariance (3, 3) of all of them."""
        return np.asarray(self.cov_others + self.var_delay_s2 * np.outer(self.per_s, self.per_s))


@record
class Turn:
    """The turn `rad` (3,) of the right camera that a frame shows.

    `cov` (3, 3): of its measurement; `chi2`: of a usual one; `apparent`: what it may contain.
    """

    rad: Array
    cov: Array
    chi2: float
    apparent: ApparentTurns

    def distances2(self, covs: Array) -> tuple[Array, Array]:
        """Return the squared distances (n,) of the turn by covariances (n, 3, 3), and the log determinants of these."""
        solved = np.linalg.solve(covs, self.rad[:, None])[..., 0]
        return solved @ self.rad, np.linalg.slogdet(covs)[1]


@record
class UsualTurns:
    """Statistics of the usual turns.

    `measured` (3, 3): the covariance of what was measured; `real` (3, 3): the same without measurement noise; `frames`:
    how many they are learnt from. `sizes`: of the turn in the latest frame, in units of `real`. `late` (2,):
    information about the delay of the right camera in all turns, and its weighted sum.
    """

    rules: TurnRules
    measured: Array
    real: Array
    frames: int
    sizes: Sizes
    late: Array

    @classmethod
    def begun(cls, rules: TurnRules) -> "UsualTurns":
        """Return the first guess."""
        guess = np.eye(3) * rules.first_guess_rad**2
        return cls(rules, guess, guess, rules.guess_frames, Sizes(), np.zeros(2))

    @cached_property
    def root(self) -> Array:
        """A root (3, 3) of the covariance of turns of the present size."""
        return self.sizes.probable * np.asarray(np.linalg.cholesky(self.real), np.float64)

    def log_odds(self, turn: Turn) -> float:
        """Return the log of how much likelier a turn is with a knock than without, eq. (72f).

        `measured` follows from three numbers in each frame. So usual turns have a t-distribution: in the
        first frames nobody knows how much this rig shakes.
        """
        n = 3.0 * (max(self.frames - self.rules.guess_frames, 0) + 1)
        usual = self.measured + turn.cov + turn.apparent.cov
        knocked = usual + self.rules.std_rad**2 * np.eye(3)
        (d2, d2_knocked), (log_det, log_det_knocked) = turn.distances2(np.stack([usual, knocked]))
        log_usual = math.lgamma((n + 3) / 2) - math.lgamma(n / 2) - 1.5 * math.log(n / 2)
        log_usual -= (n + 3) / 2 * math.log1p(d2 / n) + log_det / 2
        return float(-d2_knocked / 2 - log_det_knocked / 2 - log_usual)

    def sized(self, turn: Turn) -> "UsualTurns":
        """Return the statistics with the size of the turn of the latest frame."""
        covs = turn.cov + turn.apparent.cov + SIZES[:, None, None] ** 2 * self.real
        d2, log_det = turn.distances2(covs)
        return changed(self, sizes=self.sizes.after(-0.5 * (d2 + log_det)))

    def learnt(self, turn: Turn) -> "UsualTurns":
        """Return the statistics after a turn that counts as usual.

        A delay is one unknown of the run and no noise of each frame: what the turns of all frames say about it counts.
        The covariance of real turns follows by expectation maximisation (Dempster, Laird and Rubin 1977).
        """
        apparent = turn.apparent
        per_s, var_s2, others = apparent.per_s, apparent.var_delay_s2, turn.cov + apparent.cov_others
        frames = min(self.frames + 1, MEMORY_FRAMES)
        by_delay = np.linalg.solve(self.real + others, per_s)
        late = (1 - 1 / frames) * self.late + (by_delay @ per_s, by_delay @ turn.rad)
        var_s2 = 1 / (1 / var_s2 + late[0]) if var_s2 > 0 else 0.0
        rad, cov = turn.rad - var_s2 * late[1] * per_s, others + var_s2 * np.outer(per_s, per_s)
        counts = 1.0 if turn.chi2 < self.rules.limit else self.rules.limit / turn.chi2
        gain = np.linalg.solve(self.real + cov, self.real).T
        expected = symmetric(counts * gain @ np.outer(rad, rad) @ gain.T + self.real - gain @ self.real)
        return changed(
            self,
            measured=self.measured + (counts * np.outer(turn.rad, turn.rad) - self.measured) / frames,
            real=self.real + (expected - self.real) / frames,
            frames=frames,
            late=late,
        )
