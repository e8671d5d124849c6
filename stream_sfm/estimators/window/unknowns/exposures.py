"""Exposure times of the frames of a window, and the uncertainty of the newest pose from that of its velocity.

Cameras tick evenly, but a host may stamp frames when it processes them. If views depend on velocities, an error of a
stamp by a hundredth of a period becomes a velocity error of one hundredth. So two models are compared: frames were
exposed at their stamps, or at the ticks of an even clock.

The velocity at the newest frame is an extrapolation. The change of twists once later frames are known is learnt during
the run; with the current delay and readout it shifts the views, and so adds to the covariance of the newest pose, eq.
(70b).
"""

from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from .... import core
from ....geometry import Array
from ....geometry.medians import MEMORY_FRAMES, median
from ....record import record

_LATER = 3  # frames after which the velocity of a frame does not become more certain


class ExposureClock:
    """Learns during a run which of the two models holds: wrong times cause apparent accelerations."""

    def __init__(self) -> None:
        self._even = 0.0  # log odds

    def seconds(self, cams_from_ref: Array, stamps_ns: list[int], std_acceleration: Array) -> Array:
        """Return the exposure times (n,) of cameras (n, 4, 4) at ascending stamps, since the first stamp.

        To be called once per frame. `std_acceleration` (6,): the scale for comparing accelerations.
        """
        stamps = np.array([(s - stamps_ns[0]) / 1e9 for s in stamps_ns])
        if len(stamps) < 5:  # five determine a polynomial of fourth order, and the period of a clock
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
    """Learns the covariance `cov` (6, 6) of the newest twist of a map, from the later changes of twists."""

    def __init__(self) -> None:
        self._first: dict[int, Array] = {}
        self._cov = np.zeros((6, 6))
        self._frames = 0

    def add(self, indices: list[int], twists: Array) -> None:
        """Add the twists (n, 6) of frames, as estimated with the newest one."""
        if len(indices) <= _LATER or not twists.any():
            return
        self._first[indices[-1]] = twists[-1]
        before = self._first.pop(indices[-1 - _LATER], None)
        if before is not None:
            change = twists[-1 - _LATER] - before
            self._frames += 1
            self._cov += (np.outer(change, change) - self._cov) / min(self._frames, MEMORY_FRAMES)

    def cov(self, std_acceleration: Array, seconds: Array) -> Array:
        """Return the covariance (6, 6) for a map with frames at times (n,).

        Before it is learnt, it is that of an acceleration of σ (6,) since the previous frame. The error of an
        extrapolation from frames that are further apart than usual grows with the square of the time.
        """
        apart = np.diff(seconds)
        further = (apart[-_LATER:].max() / median(apart)) ** 2
        weight = min(self._frames / _LATER, 1.0)
        return weight * further**2 * self._cov + (1 - weight) * np.diag((std_acceleration * apart[-1]) ** 2)


@record
class Exposures:
    """A block of a map's state: when the reference camera and the window's frames were exposed.

    `seconds` (F + 1,) since the first of them, and `motions` (F + 1, 2, 6) of points at these times. `has_twist`:
    whether frames have room for the errors of their twists. `by_twist` (2,): whether the error of the newest twist
    counts, through delay and through readout. `clock` and `twist_error` learn.
    """

    seconds: Array
    motions: Array
    clock: ExposureClock
    twist_error: TwistError
    has_twist: bool = False
    by_twist: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(2, bool))

    @classmethod
    def of_reference(cls) -> "Exposures":
        """Return the exposures of a new map."""
        return cls(np.zeros(1), np.zeros((1, 2, 6)), ExposureClock(), TwistError())
