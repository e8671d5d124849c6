"""What the newest pose does not know because the velocity is not known yet: it turns delay and readout into errors.

The velocity at the newest frame is an extrapolation. By how much twists change once later frames are known is learnt
during the run; what that does to the views, by delay and readout as they are known, moves the newest pose, eq. (70b).
"""

import numpy as np

from ...geometry.medians import MEMORY_FRAMES
from ...geometry.se3 import Array

_LATER = 3  # frames after which the velocity of a frame is known as well as it ever will be


class TwistError:
    """Learns the covariance `cov` (6, 6) of the newest twist of a map, from how twists change."""

    def __init__(self) -> None:
        self._first: dict[int, Array] = {}
        self._cov = np.zeros((6, 6))
        self._frames = 0

    def add(self, indices: list[int], twists: Array) -> None:
        """Take the twists (n, 6) of frames as they are known with the newest one."""
        if len(indices) <= _LATER or not twists.any():
            return
        self._first[indices[-1]] = twists[-1]
        before = self._first.pop(indices[-1 - _LATER], None)
        if before is not None:
            change = twists[-1 - _LATER] - before
            self._frames += 1
            self._cov += (np.outer(change, change) - self._cov) / min(self._frames, MEMORY_FRAMES)

    def cov(self, std_acceleration: Array, seconds: Array) -> Array:
        """Return the covariance (6, 6), where the map has frames at times (n,).

        As learnt; before, that of an acceleration of σ (6,) since the frame before. An extrapolation from frames that
        are further apart than usual errs with the square of the time.
        """
        apart = np.diff(seconds)
        further = (apart[-_LATER:].max() / np.median(apart)) ** 2
        weight = min(self._frames / _LATER, 1.0)
        return weight * further**2 * self._cov + (1 - weight) * np.diag((std_acceleration * apart[-1]) ** 2)
