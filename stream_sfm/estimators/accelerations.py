"""How much a camera accelerates: as assumed, or as much as this run has shown, eq. (43b)."""

import numpy as np

from ..geometry import Array, se3
from ..geometry.medians import MEMORY_FRAMES
from ..record import changed, record

# With 0.1 mm of noise in positions, second differences are 0.1 m/s² in this time, and 10 m/s² between frames at 200 Hz.
_LEAST_S = 0.05


@record
class Accelerations:
    """The accelerations of a run, which differ less between axes than between linear and angular ones.

    `assumed` (6,): σ before any is seen, and the least one, as a camera that moves evenly may still speed up. `squares`
    (2,): the mean square of the linear and of the angular components, from so many `counted` velocities and the assumed
    ones. `at`: stamp, pose (4, 4) and velocity (6,) of the last one; None after a gap, and the velocity is None until
    there is another pose.
    """

    assumed: Array
    squares: Array
    counted: int = 0
    at: tuple[int, Array, Array | None] | None = None

    @classmethod
    def of(cls, assumed: Array) -> "Accelerations":
        """Return the accelerations before any pose."""
        return cls(assumed, _mean_squares(assumed))

    @property
    def std(self) -> Array:
        """σ (6,) of each component."""
        return np.maximum(self.assumed, np.repeat(np.sqrt(self.squares), 3))

    def interrupted(self) -> "Accelerations":
        """Return the accelerations after a gap: the next pose does not continue the earlier ones, or may be wrong."""
        return changed(self, at=None)

    def after(self, stamp_ns: int, world_from_cam: Array) -> "Accelerations":
        """Return the accelerations after the pose (4, 4) of the next frame."""
        if self.at is None:
            return changed(self, at=(stamp_ns, world_from_cam, None))
        last_ns, pose, before = self.at
        if (seconds := (stamp_ns - last_ns) / 1e9) < _LEAST_S * (1 - 1e-6):
            return self
        velocity = se3.log(se3.inverse(pose) @ world_from_cam) / seconds
        now = changed(self, at=(stamp_ns, world_from_cam, velocity))
        if before is None:
            return now
        counted = min(self.counted + 1, MEMORY_FRAMES)
        shown = _mean_squares((velocity - before) / seconds)
        return changed(now, counted=counted, squares=self.squares + (shown - self.squares) / (counted + 1))


def _mean_squares(acceleration: Array) -> Array:
    return np.asarray((acceleration.reshape(2, 3) ** 2).mean(axis=1))
