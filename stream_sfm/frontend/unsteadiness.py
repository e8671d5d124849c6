"""How unsteadily a camera moves in a run: by how much its motions change from frame to frame."""

import numpy as np

from ..geometry.se3 import Array
from ..record import record

_FRAMES = 30  # over which changes of the motion are averaged
_ASSUMED = 5.0  # frames that the assumed ones count for
_AT_MOST = 9.0  # times the mean square: a jump that was a body's says nothing of the camera


@record
class Unsteadiness:
    """By how much motions change from frame to frame in this run, by mean squares (2,) of translations and turns.

    In m² and rad², beside what is assumed of any camera, over so many `frames`.
    """

    mean_square: Array
    frames: float = _ASSUMED

    def after(self, change: Array) -> "Unsteadiness":
        """Return the same after a motion that differs by (6,) from the one predicted."""
        frames = min(self.frames + 1, _FRAMES)
        square = np.minimum((change.reshape(2, 3) ** 2).mean(axis=1), _AT_MOST * self.mean_square)
        return Unsteadiness(self.mean_square + (square - self.mean_square) / frames, frames)

    @property
    def std(self) -> Array:
        """σ (6,) of a change."""
        return np.repeat(np.sqrt(self.mean_square), 3)
