"""The unsteadiness of a camera in a run: how much its motion changes from frame to frame."""

import numpy as np

from ...geometry import Array
from ...record import record
from ..rules import MotionRules


@record
class Unsteadiness:
    """How much motions change from frame to frame: mean squares (2,), m² and rad², of translations and turns.

    They are averages over the assumption for any camera and over this run, `frames` in all.
    """

    mean_square: Array
    frames: float
    rules: MotionRules

    def after(self, change: Array) -> "Unsteadiness":
        """Return the same after a motion that differs by (6,) from the one predicted."""
        frames = min(self.frames + 1, self.rules.unsteady_frames)
        square = np.minimum((change.reshape(2, 3) ** 2).mean(axis=1), self.rules.most_unsteady * self.mean_square)
        return Unsteadiness(self.mean_square + (square - self.mean_square) / frames, frames, self.rules)

    @property
    def std(self) -> Array:
        """The σ (6,) of a change."""
        return np.repeat(np.sqrt(self.mean_square), 3)
