"""How unsteadily a camera moves in a run: by how much its motions change from frame to frame."""

import numpy as np

from ..config.rules import MotionRules
from ..geometry import Array
from ..record import record


@record
class Unsteadiness:
    """By how much motions change from frame to frame in this run, by mean squares (2,) of translations and turns.

    In m² and rad², beside what is assumed of any camera, over so many `frames`.
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
        """σ (6,) of a change."""
        return np.repeat(np.sqrt(self.mean_square), 3)
