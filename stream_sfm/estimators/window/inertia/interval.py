"""Inertial samples between two frames of a map, preintegrated, eqs. (78) and (79)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .... import core
from ....geometry import Array, se3
from ....geometry.linear import symmetric
from ....inertial.buffer import Samples
from ....inertial.samples import ImuCalibration
from ....inertial.state import ACCEL_BIAS, AXES, BIASES, CLOCK, GRAVITY, GYRO_BIAS, STATE, VELOCITY
from ....record import changed, filled, record
from ..layout import Layout

# A pose, perturbed as (translation, rotation), and the state: of the world in the prior, of a camera in `Known`.
JOINT = Layout(pose=6, state=STATE)
# The variables that `Leaving` has information about.
OF_LEAVING = Layout(pose=6, state=STATE, slide=3, velocity=3)
# Variances without a measurement: of a rotation, a velocity, and a displacement within an interval.
_UNKNOWN = np.repeat([4.0, 400.0, 400.0], 3)
_LEAST = np.repeat([1e-14, 1e-12, 1e-14], 3)
# In an interval of few samples, errors of velocity and displacement are those of the same samples. This share of their
# variances keeps their covariance definite, however large it is.
_WITH_SHARE = np.ones((9, 9)) + 1e-9 * np.eye(9)
_OPEN = 1e4  # factor on the variance of an interval that contradicts the images


@record
class Interval:
    """The result of `core.preintegrate` between two stamps, at `biases` (6,) and a time offset `clock`.

    `std_walk` (6,): σ of the random walk of the biases; `complete`: whether all samples were there; `dense`: whether
    none was missing for long, so that they tell the motion; `by_time` (9,): the derivative by the length of the
    interval, and `var_time`, s²: the variance of this length.
    """

    rotation: Array
    motion: Array
    by_bias: Array
    by_clock: Array
    cov_gyro: Array
    cov_accel: Array
    biases: Array
    clock: float
    seconds: float
    std_walk: Array
    by_time: Array
    var_time: float = 0.0
    opened: float = 1.0
    complete: bool = True
    dense: bool = True
    note: str = ""

    @classmethod
    def of(
        cls, samples: Samples, calibration: ImuCalibration, state: Array, factors: Array, var_time: float = 0.0
    ) -> "Interval":
        """Preintegrate samples at the biases and the clock of a state (17,); `factors` (3,): on the noise densities."""
        of = calibration
        parts = core.preintegrate(
            *(samples.seconds, samples.gyro, samples.accel, samples.widened, state[BIASES]),
            np.array([of.gyro_noise, of.accel_noise]),
        )
        seconds = float(samples.seconds[-1] - samples.seconds[0])
        std_walk = np.repeat(factors[:2] * np.array([of.gyro_walk, of.accel_walk]) * np.sqrt(seconds), 3)
        clock = float(state[CLOCK][0])
        of_samples = {"complete": samples.complete, "dense": samples.dense, "note": samples.note}
        of_samples |= {"std_walk": std_walk}
        by_time = _by_time(samples, calibration.cam_from_imu[:3, :3], state, parts)
        of_samples |= {"by_time": by_time, "var_time": var_time}
        return filled(cls, parts, biases=state[BIASES].copy(), clock=clock, seconds=seconds, **of_samples)

    @classmethod
    def unknown(cls, seconds: float, state: Array) -> "Interval":
        """Return an interval without samples."""
        nothing, unknown = np.zeros((9, 9)), np.diag(_UNKNOWN)
        std_walk = np.repeat([1e-4, 1e-3], 3) * np.sqrt(seconds)
        biases, clock = state[BIASES].copy(), float(state[CLOCK][0])
        return cls(
            np.eye(3), np.zeros((2, 3)), np.zeros((9, 6)), np.zeros((3, 3)), nothing, unknown,
            biases, clock, seconds, std_walk, np.zeros(9), dense=False, note="there are no inertial samples",
        )  # fmt: skip

    @property
    def lacks_end(self) -> bool:
        """Whether the last samples were missing, but not for long, and the others contradict nothing."""
        return not self.complete and self.dense and self.opened == 1.0

    def open(self, distance2: float) -> "Interval":
        """Return the interval with nearly no information, where a motion is at this squared distance from it."""
        return changed(self, opened=max(_OPEN, 1e2 * distance2))  # a tenth of σ is left

    @property
    def is_open(self) -> bool:
        """Whether it has nearly no information."""
        return self.opened >= _OPEN

    def wider(self, factor: float) -> "Interval":
        """Return the interval with a variance that is larger by at least this factor."""
        return changed(self, opened=max(self.opened, factor))


class Intervals(NamedTuple):
    """Consecutive intervals (n) as arguments of `core.inertial_rows`: the fields of `Interval` as arrays."""

    rotation: Array
    motion: Array
    by_bias: Array
    by_clock: Array
    cov: Array
    biases: Array
    clock: Array
    seconds: Array

    @property
    def oldest(self) -> "Intervals":
        return Intervals(*(of_all[:1] for of_all in self))

    @classmethod
    def of(cls, intervals: Sequence[Interval], factors: Array) -> "Intervals":
        """Stack intervals, with factors on the noise densities."""
        n, (gyro2, accel2) = len(intervals), factors[:2] ** 2
        opened = np.array([i.opened for i in intervals])[:, None, None]
        by_both = gyro2 * np.array([i.cov_gyro for i in intervals]) + accel2 * np.array(
            [i.cov_accel for i in intervals]
        )
        return cls(
            np.array([i.rotation for i in intervals]),
            np.array([i.motion for i in intervals]).reshape(n, 6),
            np.array([i.by_bias for i in intervals]),
            np.array([i.by_clock for i in intervals]).reshape(n, 9),
            np.diag(_LEAST) + opened * by_both * _WITH_SHARE + _of_time(intervals),
            np.array([i.biases for i in intervals]),
            np.array([i.clock for i in intervals]),
            np.array([i.seconds for i in intervals]),
        )


@record
class Leaving:
    """The information about a leaving frame: `h` (n, n) and `g` (n,) of its pose (6), the state of the reference (17),
    its slide (3) and its velocity (3); the current `slide` and `velocity`, and σ of the walk of the biases (6,)."""

    h: Array
    g: Array
    slide: Array
    velocity: Array
    std_walk: Array


@record
class Known:
    """Pose and state (17,) of a camera at a stamp, and their joint covariance (23, 23)."""

    stamp_ns: int
    world_from_cam: Array
    state: Array
    cov: Array

    @property
    def cov_pose(self) -> Array:
        """The covariance (6, 6) of the pose."""
        return self.cov[JOINT["pose"], JOINT["pose"]]

    @property
    def cov_state(self) -> Array:
        """The covariance (17, 17) of the state."""
        return self.cov[JOINT["state"], JOINT["state"]]

    def carried(self, by: "Transition", stamp_ns: int) -> "Known":
        """Return pose and state after a transition, with their joint covariance, eq. (81)."""
        cov = by.rows @ self.cov @ by.rows.T + by.cov
        pose = se3.orthonormalise(self.world_from_cam @ by.previous_from_now)
        return Known(stamp_ns, pose, by.state, symmetric(cov))


@record
class Transition:
    """The step from one pose and state to the next by the samples of an `interval`, eq. (81).

    It consists of the motion `previous_from_now` (4, 4) and the new `state` (17,), and of the Jacobian `rows` (23, 23)
    and the noise `cov` (23, 23) of both together.
    """

    previous_from_now: Array
    state: Array
    rows: Array
    cov: Array
    interval: Interval


def _by_time(samples: Samples, cam_from_imu: Array, state: Array, parts: core.Preintegrated) -> Array:
    """Return the derivative of (rotation, velocity, position) by the length of an interval, per second, eq. (80)."""
    to_imu = (cam_from_imu @ se3.exp_so3(state[AXES])).T
    seconds, (dv, _) = float(samples.seconds[-1] - samples.seconds[0]), parts.motion
    force = parts.rotation @ (samples.accel[-1] - state[ACCEL_BIAS])
    at_end = to_imu @ (state[VELOCITY] + seconds * state[GRAVITY]) + dv
    return np.concatenate([samples.gyro[-1] - state[GYRO_BIAS], to_imu @ state[GRAVITY] + force, at_end])


def _of_time(intervals: Sequence[Interval]) -> Array:
    """Return the covariances (n, 9, 9) of intervals from errors of their lengths."""
    roots = np.array([np.sqrt(i.var_time) * i.by_time for i in intervals])
    return np.asarray(roots[:, :, None] * roots[:, None, :])


def transition(state: Array, interval: Interval, factors: Array, cam_from_imu: Array) -> Transition:
    """Return the step to the pose and the state at the end of an interval."""
    moved = core.inertial_motion(Intervals.of([interval], factors), state, cam_from_imu, interval.std_walk)
    return Transition(*moved, interval)
