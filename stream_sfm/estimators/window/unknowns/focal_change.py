"""The evidence of a frame for a changing focal length: what it shows, predicted with and without a change, eq. (72l).

Amounts are relative changes of the focal length against that of the points, in units of `rig.std_refocused`.
"""

from dataclasses import field

import numpy as np

from ....geometry import Array
from ....geometry.sizes import REDRAWN
from ....record import changed, record

_STD_MEAN = 0.02  # of calm frames, before any: KITTI and Karlsruhe have 0.02 and 0.04
# σ of a change from frame to frame: an autofocus that moves slowly, evenly, and at 10 % per second. With larger ones a
# frame of few views, all of a wall, would show a zoom of 4 %.
_STEPS = np.array([0.01, 0.05, 0.25])


def _even(sizes: Array) -> Array:
    return np.full(len(sizes), 1 / len(sizes))


@record
class Calm:
    """What frames show while the focal length rests: N(mean, `spread` times the variance that they state).

    Errors of calibration and depths have one sign throughout a run, so there is a mean: `information` about it in the
    latest frames, and its `weighted` sum. `frames`: how many `spread` is learnt from.
    """

    frames: float
    spread: float = 1.0
    information: float = 0.0
    weighted: float = 0.0

    @property
    def mean(self) -> float:
        return self.weighted * self.var_mean

    @property
    def var_mean(self) -> float:
        """The variance of the mean amount."""
        return 1 / (self.information + _STD_MEAN**-2)

    @property
    def factor(self) -> float:
        """The factor on the variance that a frame states."""
        return max(self.spread, 1.0)

    def log_of(self, shown: Array, var: Array) -> Array:
        """Return the log probabilities (g,) of a frame that shows these amounts (g,)."""
        return log_normal(shown - self.mean, self.factor * var + self.var_mean)

    def learnt(self, shown: float, var: float, probability: float, most_frames: int) -> "Calm":
        """Return the statistics after a frame that was calm with this probability."""
        frames = min(self.frames + probability, float(most_frames))
        square = (shown - self.mean) ** 2 / (var + self.var_mean)
        information, kept = probability / (self.factor * var), 1 - probability / most_frames
        return Calm(
            frames,
            self.spread + probability * (square - self.spread) / frames,
            kept * self.information + information,
            kept * self.weighted + information * shown,
        )


@record
class Change:
    """The focal length if it changes: N(`at`, `var`), and the probabilities `steps` (3,) of sizes of its changes."""

    at: float = 0.0
    var: float = 0.0
    steps: Array = field(default_factory=lambda: _even(_STEPS))

    def log_of(self, shown: Array, var: Array) -> Array:
        """Return the log of the joint probability (g, 3) of a frame that shows these amounts (g,), and of each step."""
        return log_normal(shown[:, None] - self.at, var[:, None] + self.var + _STEPS**2) + np.log(self.steps)

    def after(self, shown: float, var: float) -> "Change":
        """Return the change after a frame, by a Kalman filter for each size of step."""
        log, prior = self.log_of(np.array([shown]), np.array([var]))[0], self.var + _STEPS**2
        weights = np.exp(log - np.logaddexp.reduce(log))
        gain = prior / (prior + var)
        at = self.at + gain * (shown - self.at)
        mean = float(weights @ at)
        spread = float(weights @ ((1 - gain) * prior + (at - mean) ** 2))
        return changed(self, at=mean, var=spread, steps=(1 - REDRAWN) * weights + REDRAWN * _even(_STEPS))


def log_normal(apart: Array, var: Array) -> Array:
    """Return the log densities of N(0, `var`), but for a constant."""
    return np.asarray(-0.5 * (apart**2 / var + np.log(var)))
