"""The usual turns of the right camera in a run: real rigs vibrate, or are not quite synchronous."""

from functools import cached_property
from typing import Annotated

import numpy as np

from ... import core
from ...config.section import Section, expert
from ...geometry import Array
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
    `var_delay_s2`, and errs by `std_rad` about each axis, as the rate does.
    """

    cov_others: Array
    per_s: Array
    var_delay_s2: float
    std_rad: float = 0.0

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

    def distance2(self, usual: Array) -> float:
        """Return the squared distance of the turn from usual ones with this covariance (3, 3)."""
        return float(self.rad @ np.linalg.solve(usual + self.cov, self.rad))


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

    def sized(self, turn: Turn) -> tuple["UsualTurns", float]:
        """Return the statistics with the size of the turn of the latest frame, and the log odds of a knock, eq. (72f).

        The latter say how much likelier the turn is with a knock than without. `measured` follows from three numbers
        in each frame. So usual turns have a t-distribution: in the first frames nobody knows how much this rig shakes.
        """
        log_odds, log_likelihoods = core.weigh_turn(self, turn, SIZES)
        return changed(self, sizes=self.sizes.after(log_likelihoods)), log_odds

    def learnt(self, turn: Turn) -> "UsualTurns":
        """Return the statistics after a turn that counts as usual.

        A delay is one unknown of the run and no noise of each frame: what the turns of all frames say about it counts.
        The covariance of real turns follows by expectation maximisation (Dempster, Laird and Rubin 1977).
        """
        frames = min(self.frames + 1, MEMORY_FRAMES)
        measured, real, late = core.learn_turn(self, turn, frames)
        return changed(self, measured=measured, real=real, frames=frames, late=late)
