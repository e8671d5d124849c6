"""The latest samples of an inertial unit, which are checked on arrival and returned by intervals.

Impossible samples are dropped or given larger variances, and counted, so that the estimate relies less on them. Nothing
waits for samples.
"""

from copy import copy

import numpy as np
from numpy.typing import NDArray

from ..geometry import Array
from ..geometry.medians import median
from ..record import record
from ..system.inputs import INT64
from .samples import ImuCalibration, ImuSamples
from .settings import SETTINGS


@record
class Samples:
    """The samples of an interval, its ends interpolated: `seconds` (n,), `gyro`, `accel` (n, 3); `widened` (n − 1,),
    factors on the variance of each step. `complete`: they reach beyond both ends; `dense`: none is missing for long;
    `note`: problems with them."""

    seconds: Array
    gyro: Array
    accel: Array
    widened: Array
    complete: bool
    dense: bool
    note: str


class SampleBuffer:
    """Samples of the last seconds, in the clock of the camera as far as its offset is calibrated.

    `counts`: samples that were taken, that are no
    measurements, with stamps that do not ascend, with stamps far ahead of their frame, saturated.
    """

    def __init__(self, calibration: ImuCalibration) -> None:
        self._offset_ns = round(calibration.time_offset_s * 1e9)
        self._ranges = calibration.gyro_range_rad_s, calibration.accel_range_m_s2
        self._samples = ImuSamples.joined([])
        self._saturated = np.zeros(0, bool)
        self._sizes = np.zeros((0, 2))  # of rates and accelerations, of the latest samples as they came
        self._period_ns = 0.0
        self._unasked = 0  # samples whose units have not been checked
        self._problem = ""  # of the units
        self.counts = {"samples": 0, "no measurement": 0, "backwards": 0, "ahead": 0, "saturated": 0}

    @property
    def problem(self) -> str:
        """Why none of the samples can be used at present; empty if they can."""
        if len(self._samples) >= SETTINGS.fewest and self._period_ns > SETTINGS.dense_s * 1e9:
            return (
                f"the IMU is not used: it gives a sample every {self._period_ns / 1e6:.0f} ms, which is too seldom "
                f"to follow a motion: give one every {1e3 * SETTINGS.dense_s:.0f} ms at least"
            )
        return self._problem

    def copied(self) -> "SampleBuffer":
        """Return a copy that continues independently."""
        other = copy(self)
        other.counts = dict(self.counts)
        return other

    @property
    def last_ns(self) -> int | None:
        """The stamp of the newest sample."""
        return int(self._samples.stamps_ns[-1]) if len(self._samples) else None

    def add(self, samples: ImuSamples, frame_ns: int = INT64) -> None:
        """Take the samples that came with a frame at this stamp, except those that are already present."""
        samples = ImuSamples(samples.stamps_ns - self._offset_ns, samples.gyro_rad_s, samples.accel_m_s2)
        ahead = samples.stamps_ns > frame_ns + round(SETTINGS.ahead_s * 1e9)
        self.counts["ahead"] += int(ahead.sum())
        samples = _only(samples, ~ahead)
        self._forget_contradicted(samples)
        if self.last_ns is not None:
            samples = _only(samples, samples.stamps_ns > self.last_ns)
        if not len(samples):
            return
        self.counts["samples"] += len(samples)
        taken = _only(samples, ~_stray(samples.stamps_ns))
        ascends = np.ones(len(taken), bool)
        ascends[1:] = taken.stamps_ns[1:] > np.maximum.accumulate(taken.stamps_ns)[:-1]
        self.counts["backwards"] += len(samples) - int(ascends.sum())
        samples = _only(taken, ascends)
        samples = _only(samples, self._finite(samples))
        self._unasked += len(samples)
        self._keep(_only(samples, self._measured(samples)))
        if self._unasked >= SETTINGS.unit_samples:
            self._unasked, self._problem = 0, self._unit_problem()

    def _finite(self, samples: ImuSamples) -> NDArray[np.bool_]:
        """Return which samples (n,) are numbers at all."""
        values = np.concatenate([samples.gyro_rad_s, samples.accel_m_s2], axis=1)
        finite: NDArray[np.bool_] = np.isfinite(values).all(axis=1)
        self.counts["no measurement"] += int((~finite).sum())
        return finite

    def _measured(self, samples: ImuSamples) -> NDArray[np.bool_]:
        """Return which samples (n,) their sensors can have measured: others are errors of the transfer.

        The sizes of all are kept, as they show whether the unit is another one.
        """
        both = samples.gyro_rad_s, samples.accel_m_s2
        largest = np.stack([np.abs(values).max(axis=1, initial=0.0) for values in both], axis=1)
        within = np.asarray((largest <= SETTINGS.beyond_range * np.array(self._ranges)).all(axis=1))
        self.counts["no measurement"] += int((~within).sum())
        sizes = np.stack([np.linalg.norm(np.clip(v, -1e9, 1e9), axis=1) for v in both], axis=1)
        self._sizes = np.concatenate([self._sizes, sizes])[-SETTINGS.most_sizes :]
        return within

    def _keep(self, kept: ImuSamples) -> None:
        """Append samples, and forget old ones."""
        if not len(kept):
            return
        everything = ImuSamples.joined([self._samples, kept])
        newest_ns = int(everything.stamps_ns[-2:][0])  # the last stamp may be ahead
        old = int(np.searchsorted(everything.stamps_ns, newest_ns - round(SETTINGS.kept_s * 1e9), "right"))
        found = self._find_saturated(everything[-len(kept) - SETTINGS.equal :])
        saturated = np.concatenate([self._saturated, np.zeros(len(kept), bool)])
        saturated[-len(found) :] |= found
        self.counts["saturated"] += int(saturated.sum() - self._saturated.sum())
        self._samples, self._saturated = everything[old:], saturated[old:]
        if len(self._samples) > 1:
            self._period_ns = median(np.diff(self._samples.stamps_ns[-200:]))

    def _forget_contradicted(self, samples: ImuSamples) -> None:
        """Forget the newest sample if its stamp is ahead of a new sample."""
        kept_ns = self._samples.stamps_ns
        if len(samples) and len(kept_ns) and _stray(np.r_[kept_ns[-2:], samples.stamps_ns[0]])[-2]:
            self.counts["backwards"] += 1
            self._samples, self._saturated = self._samples[:-1], self._saturated[:-1]

    def _find_saturated(self, samples: ImuSamples) -> NDArray[np.bool_]:
        """Return which samples (n,) are at the end of the range of the sensor: beyond it, or large and constant."""
        found = np.zeros(len(samples), bool)
        for values, most in zip((samples.gyro_rad_s, samples.accel_m_s2), self._ranges, strict=True):
            found |= (np.abs(values) >= most).any(axis=1)
            same = np.zeros(len(samples), bool)
            same[1:] = ((values[1:] == values[:-1]) & (np.abs(values[1:]) > SETTINGS.least_range * most)).any(axis=1)
            if np.count_nonzero(same) < SETTINGS.equal - 1:  # there hardly ever are any
                continue
            runs = np.lib.stride_tricks.sliding_window_view(values, SETTINGS.equal, axis=0)  # (n − 4, 3, 5)
            stuck = (runs == runs[..., :1]).all(axis=2) & (np.abs(runs[..., 0]) > SETTINGS.least_range * most)
            for start in np.flatnonzero(stuck.any(axis=1)):
                found[start : start + SETTINGS.equal] = True
        return found

    def _unit_problem(self) -> str:
        """Say that samples are in other units, if their magnitudes are, or that they are too few."""
        turned, norm = np.median(self._sizes, axis=0)
        if SETTINGS.in_g[0] < norm < SETTINGS.in_g[1]:
            return (
                f"the IMU is not used: its accelerations are about {norm:.2f} in the median, which looks like g: give "
                "m/s² (multiply by 9.80665), gravity included"
            )
        if norm < SETTINGS.in_g[0]:
            return (
                f"the IMU is not used: its accelerations are about {norm:.2g} m/s² in the median: gravity seems to "
                "have been taken out; give the raw accelerations"
            )
        if norm > 100:
            return f"the IMU is not used: its accelerations are about {norm:.0f} m/s² in the median: give m/s²"
        if turned > self._ranges[0]:
            return (
                f"the IMU is not used: it turns at {turned:.0f} rad/s in the median, beyond its range: are these "
                "degrees? Give rad/s"
            )
        return ""

    def covers(self, first_ns: int, last_ns: int) -> bool:
        """Whether there is a sample within an interval, or close enough to it to extrapolate."""
        stamps = self._samples.stamps_ns
        if not len(stamps):
            return False
        reach_ns = max(5 * self._period_ns, 1e7)
        return bool(stamps[0] <= first_ns + reach_ns and stamps[-1] >= min(first_ns, last_ns - reach_ns))

    def mean_acceleration(self, stamp_ns: int) -> Array | None:
        """Return the mean specific force (3,) in the tenth of a second before a time, or else just after it.

        None without nearby samples, or if these come too seldom.
        """
        stamps = self._samples.stamps_ns
        near = (stamps <= stamp_ns + 1e7) & (stamps >= stamp_ns - 10**8)
        seldom = (np.diff(stamps[stamps <= stamp_ns + 1e7][-2:]) > SETTINGS.dense_s * 1e9).any()
        return self._samples.accel_m_s2[near].mean(axis=0) if near.any() and not seldom else None

    def noise(self) -> Array | None:
        """Return the noise densities (2,) of gyroscope and accelerometer from differences between neighbouring samples.

        None with few samples. For a unit that smooths its samples they are too small.
        """
        if len(self._samples) < SETTINGS.noise_samples:
            return None
        values = np.stack([self._samples.gyro_rad_s, self._samples.accel_m_s2])
        apart = np.abs(np.diff(values, SETTINGS.differences, axis=1)).reshape(2, -1)
        # 0.6745: the median of absolute values of N(0, 1)
        return np.asarray(np.median(apart, axis=1) / 0.6745 * np.sqrt(self._period_ns / 1e9 / SETTINGS.grown))

    def rate(self, stamp_ns: int, late_s: float) -> Array:
        """Return the angular rate (3,) at a time, by the samples around it."""
        return _at_time(late_s, (self._samples.stamps_ns - stamp_ns) / 1e9, self._samples.gyro_rad_s)[0]

    def turning(self, stamp_ns: int, late_s: float) -> tuple[Array, Array] | None:
        """Return angular rate and acceleration (3,) at a time, from a straight line through the samples around it."""
        at = (self._samples.stamps_ns - stamp_ns) / 1e9 - late_s
        rows = np.flatnonzero((at > -SETTINGS.turning_s) & (at < SETTINGS.turning_s / 2))
        if len(rows) < SETTINGS.least_turning or at[rows[-1]] < -SETTINGS.turning_s / 2:
            return None
        seconds, rates = at[rows], self._samples.gyro_rad_s[rows]
        mean_s = float(seconds.mean())
        acceleration = (seconds - mean_s) @ rates / np.square(seconds - mean_s).sum()
        return rates.mean(axis=0) - mean_s * acceleration, acceleration

    def between(self, first_ns: int, last_ns: int, late_s: float) -> Samples:
        """Return the samples from one stamp of the camera to another, whose clock is early by `late_s`.

        If they end too soon, the last values are held, and the variance of the step is that of a gap.
        """
        at = (self._samples.stamps_ns - first_ns) / 1e9
        first, last = late_s, late_s + (last_ns - first_ns) / 1e9
        inside = slice(int(np.searchsorted(at, first, "right")), int(np.searchsorted(at, last)))
        seconds = np.concatenate([[first], at[inside], [last]])
        gyro, accel = (
            np.concatenate([_at_time(first, at, values), values[inside], _at_time(last, at, values)])
            for values in (self._samples.gyro_rad_s, self._samples.accel_m_s2)
        )
        steps = np.diff(seconds)
        around = np.searchsorted(at, (seconds[:-1] + seconds[1:]) / 2)  # each step is between samples i − 1 and i
        spacing = np.diff(at, prepend=-np.inf, append=np.inf)[around]
        period_s = max(self._period_ns / 1e9, 1e-4)
        beyond = np.where(np.isfinite(spacing), spacing, np.where(steps > 0.5 * period_s, steps, 0.0))
        held = ~np.isfinite(spacing) & (steps > 0)
        missing_s = np.where(held, steps, beyond)  # the time without a sample
        gaps = (beyond > min(SETTINGS.gap_periods * period_s, SETTINGS.dense_s)) | held
        lost = np.concatenate([[False], self._saturated, [False]])
        saturated = lost[around] | lost[around + 1]
        long_s = np.clip(missing_s, 0.1 * SETTINGS.gap_s, SETTINGS.gone_s)
        widened = np.where(gaps, SETTINGS.widened * (long_s / SETTINGS.gap_s) ** 2, 1.0)
        widened = np.where(saturated, np.maximum(widened, SETTINGS.widened), widened)
        notes = ["inertial samples are missing"] * bool((gaps & (steps > SETTINGS.gap_periods * period_s)).any())
        notes += ["the IMU is saturated"] * bool(saturated.any())
        complete = bool(at[0] <= first and at[-1] >= last)
        dense = not (missing_s[gaps] > SETTINGS.dense_s).any()
        return Samples(seconds, gyro, accel, widened, complete, dense, "; ".join(notes))


def _only(samples: ImuSamples, wanted: NDArray[np.bool_]) -> ImuSamples:
    """Return the wanted (n,) samples: these themselves if all are."""
    return samples if wanted.all() else samples[wanted]


def _stray(stamps_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which stamps (n,) jump ahead: the next one is before them, and after the one before them.

    One such sample would make all later ones seem to go backwards.
    """
    stray = np.zeros(len(stamps_ns), bool)
    stray[:-1] = stamps_ns[1:] < stamps_ns[:-1]
    stray[1:-1] &= stamps_ns[2:] > stamps_ns[:-2]
    return stray


def _at_time(time_s: float, at: Array, values: Array) -> Array:
    """Return values (1, 3) at a time, interpolated between the samples (n, 3) before and after it."""
    k = int(np.searchsorted(at, time_s))
    if k in (0, len(at)):
        return np.asarray(values[:1] if k == 0 else values[-1:])
    share = (time_s - at[k - 1]) / (at[k] - at[k - 1])
    return np.asarray(values[k - 1 : k] + share * (values[k : k + 1] - values[k - 1 : k]))
