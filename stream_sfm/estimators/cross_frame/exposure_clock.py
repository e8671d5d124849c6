"""When the frames of a window were exposed: at their stamps, or at the ticks of an even clock.

Cameras tick evenly, but a host may stamp frames when it gets to them. Where views depend on velocities, a stamp that is
off by a hundredth of a period turns into a velocity that is off by as much.
"""

import numpy as np

from ... import core
from ...geometry.se3 import Array

_LEAST = 5  # frames that a polynomial of fourth order and the ticks of a clock are told from


class ExposureClock:
    """Learns during a run which of the two it is: wrong times feign accelerations, so that motions look rougher."""

    def __init__(self) -> None:
        self._even = 0.0  # log odds

    def seconds(self, cams_from_ref: Array, stamps_ns: list[int], std_acceleration: Array) -> Array:
        """Return the times (n,) of cameras (n, 4, 4) at ascending stamps, the newest not seen before; 0 at the first.

        `std_acceleration` (6,): what accelerations are compared by.
        """
        stamps = np.array([(s - stamps_ns[0]) / 1e9 for s in stamps_ns])
        if len(stamps) < _LEAST:
            return stamps
        ticks = np.round(stamps / np.median(np.diff(stamps)))
        if (np.diff(ticks) < 1).any():
            return stamps
        even = np.polyval(np.polyfit(ticks, stamps, 1), ticks)
        rough = [
            np.sum((core.point_motions(cams_from_ref, t)[:, 1] / std_acceleration) ** 2) for t in (stamps, even)
        ]
        if min(rough) > 0:
            self._even += 0.5 * np.log(rough[0] / rough[1])
        return even if self._even > 0 else stamps
