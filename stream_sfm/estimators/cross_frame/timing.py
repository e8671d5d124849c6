"""When the frames of a window were exposed, and what its newest pose does not know because its velocity is not known.

Cameras tick evenly, but a host may stamp frames when it gets to them. Where views depend on velocities, a stamp that is
off by a hundredth of a period turns into a velocity that is off by as much: frames were exposed at their stamps, or at
the ticks of an even clock.

The velocity at the newest frame is an extrapolation. By how much twists change once later frames are known is learnt
during the run; what that does to the views, by delay and readout as they are known, moves the newest pose, eq. (70b).
"""

from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...geometry import Array
from ...geometry.medians import MEMORY_FRAMES, median
from ...record import record

_LATER = 3  # frames after which the velocity of a frame does not become more certain


class ExposureClock:
    """Learns during a run which of the two it is: wrong times feign accelerations, so that motions look rougher."""

    def __init__(self) -> None:
        self._even = 0.0  # log odds

    def seconds(self, cams_from_ref: Array, stamps_ns: list[int], std_acceleration: Array) -> Array:
        """Return the times (n,) of cameras (n, 4, 4) at ascending stamps, since the first stamp.

        The newest camera has not been seen before. `std_acceleration` (6,): what accelerations are compared by.
        """
        stamps = np.array([(s - stamps_ns[0]) / 1e9 for s in stamps_ns])
        if len(stamps) < 5:  # they determine a polynomial of fourth order, and the period of a clock
            return stamps
        ticks = np.round(stamps / median(np.diff(stamps)))
        if (np.diff(ticks) < 1).any():
            return stamps
        apart = ticks - ticks.mean()
        even = stamps.mean() + apart @ stamps / (apart @ apart) * apart  # the straight line that fits best
        rough = [
            np.sum((core.point_motions(cams_from_ref, t)[:, 1] / std_acceleration) ** 2) for t in (stamps, even)
        ]
        if min(rough) > 0:
            self._even += 0.5 * np.log(rough[0] / rough[1])
        return even if self._even > 0 else stamps


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
        further = (apart[-_LATER:].max() / median(apart)) ** 2
        weight = min(self._frames / _LATER, 1.0)
        return weight * further**2 * self._cov + (1 - weight) * np.diag((std_acceleration * apart[-1]) ** 2)


@record
class Exposures:
    """A block of a map's state: when the reference camera and the window's frames were exposed.

    `seconds` (F + 1,) since the first of them, and `motions` (F + 1, 2, 6) of points then. `has_twist`: whether frames
    have room for the errors of their twists, and `by_twist` (2,): whether that of the newest one counts, by delay and
    by readout. `clock` and `twist_error` learn.
    """

    seconds: Array
    motions: Array
    clock: ExposureClock
    twist_error: TwistError
    has_twist: bool = False
    by_twist: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(2, bool))

    @classmethod
    def of_reference(cls) -> "Exposures":
        """Return those of a map that begins."""
        return cls(np.zeros(1), np.zeros((1, 2, 6)), ExposureClock(), TwistError())
