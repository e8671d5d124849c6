"""Exposure times of the frames of a window, and the uncertainty of the newest pose by that of its velocity, (70b).

Hosts may stamp frames when they process them. Where views depend on velocities, two models are compared: frames were
exposed at their stamps, or at the ticks of an even clock. The velocity at the newest frame is an extrapolation; the
change of twists once later frames are known is learnt during the run.
"""

from collections.abc import Mapping
from dataclasses import field

import numpy as np

from .... import core
from ....geometry import Array
from ....geometry.medians import MEMORY_FRAMES, median
from ....record import changed, record

_LATER = 3  # frames after which the velocity of a frame does not become more certain


@record
class ExposureClock:
    """What a run shows about which of the two models holds: wrong times cause apparent accelerations.

    `even`: log odds that frames were exposed at the ticks of an even clock.
    """

    even: float = 0.0

    def seconds(
        self, cams_from_ref: Array, stamps_ns: list[int], std_acceleration: Array
    ) -> tuple[Array, "ExposureClock"]:
        """Return the exposure times (n,) of cameras (n, 4, 4) at ascending stamps, since the first stamp.

        To be called once per frame, with the clock that the previous call returned. `std_acceleration` (6,): the scale
        for comparing accelerations.
        """
        stamps = np.array([(s - stamps_ns[0]) / 1e9 for s in stamps_ns])
        if len(stamps) < 5:  # five determine a polynomial of fourth order, and the period of a clock
            return stamps, self
        ticks = np.round(stamps / median(np.diff(stamps)))
        if (np.diff(ticks) < 1).any():
            return stamps, self
        apart = ticks - ticks.mean()
        even = stamps.mean() + apart @ stamps / (apart @ apart) * apart  # the straight line that fits best
        rough = [np.sum((core.point_motions(cams_from_ref, t)[:, 1] / std_acceleration) ** 2) for t in (stamps, even)]
        after = self if min(rough) <= 0 else ExposureClock(self.even + 0.5 * float(np.log(rough[0] / rough[1])))
        return even if after.even > 0 else stamps, after


@record
class TwistError:
    """The covariance (6, 6) of the newest twist of a map, learnt from the later changes of twists.

    `first`: the twists (6,) of the latest frames by index, each as estimated when it was the newest, and the size of
    its error, eq. (70e); `cov_learnt` (6, 6), of size 1, from so many `frames`.
    """

    first: Mapping[int, tuple[Array, float]] = field(default_factory=dict)
    cov_learnt: Array = field(default_factory=lambda: np.zeros((6, 6)))
    frames: int = 0

    def after(self, indices: list[int], twists: Array, size: float) -> "TwistError":
        """Return the error learnt after a frame; `twists` (n, 6) of frames, as estimated with the newest one."""
        if len(indices) <= _LATER or not twists.any():
            return self
        first = {**self.first, indices[-1]: (twists[-1], size)}
        before = first.pop(indices[-1 - _LATER], None)
        if before is None:
            return changed(self, first=first)
        change, frames = (twists[-1 - _LATER] - before[0]) / before[1], self.frames + 1
        more = (np.outer(change, change) - self.cov_learnt) / min(frames, MEMORY_FRAMES)
        return TwistError(first, self.cov_learnt + more, frames)

    def cov(self, std_change: Array, least: float) -> Array:
        """Return the covariance (6, 6) for a newest frame that follows many others evenly.

        Before it is learnt, it is that of a change of σ (6,) between two frames; `least`: the least share of this σ.
        """
        weight = min(self.frames / _LATER, 1.0)
        return weight * self.cov_learnt + (1 - weight + least**2) * np.diag(std_change**2)


@record
class Exposures:
    """A block of a map's state: when the reference camera and the window's frames were exposed.

    `seconds` (F + 1,) since the first of them, and `motions` (F + 1, 2, 6) of points at these times. `clock` and
    `twist_error`: what the run has shown about both. `has_twist`: whether the errors of these motions are unknowns;
    they have a `root` (6, 6) of their covariance, and act by a delay and a readout of `size_s` (2,).
    """

    seconds: Array
    motions: Array
    clock: ExposureClock = ExposureClock()
    twist_error: TwistError = field(default_factory=TwistError)
    has_twist: bool = False
    root: Array = field(default_factory=lambda: np.zeros((6, 6)))
    size_s: Array = field(default_factory=lambda: np.zeros(2))

    @classmethod
    def of_reference(cls) -> "Exposures":
        """Return the exposures of a new map."""
        return cls(np.zeros(1), np.zeros((1, 2, 6)))

    @property
    def errors(self) -> Array:
        """Size and bend (F + 1, 2) of the errors of `motions`, eq. (70e)."""
        return core.errors_of_motions(self.seconds, median(np.diff(self.seconds)))
