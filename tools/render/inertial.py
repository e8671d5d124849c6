"""What an inertial unit measures along a path that is known as a function of time: exact, or as a real one errs."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stream_sfm.geometry import se3
from stream_sfm.inertial.samples import ImuCalibration, ImuSamples

Array = NDArray[np.float64]
GRAVITY_M_S2 = 9.81
_STEP_S = 1e-4  # of differences: their error is 1e-7 of the second derivative of anything below 10 Hz


@dataclass(frozen=True, slots=True)
class Unit:
    """An inertial unit: rate, mounting, noise and ranges by its `calibration`, and how it errs beside that.

    `std_gyro_bias` rad/s, `std_accel_bias` m/s²: of each axis at the start. `late_s`: its clock shows as much more than
    that of the camera. `turned_rad` (3,): of the unit against its calibration. `jitter_s`: σ of its stamps.
    """

    calibration: ImuCalibration = field(
        default_factory=lambda: ImuCalibration(se3.exp([0.03, 0.015, -0.02, 0.02, -0.03, 1.55]))
    )
    rate_hz: float = 200.0
    std_gyro_bias: float = 0.01
    std_accel_bias: float = 0.08
    late_s: float = 0.0
    turned_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    jitter_s: float = 0.0


BMI160 = Unit()
# Ten times the noise at half the rate, and a narrow range.
CONSUMER = Unit(
    ImuCalibration(
        BMI160.calibration.cam_from_imu, 2e-3, 2e-4, 2e-2, 3e-3, gyro_range_rad_s=8.7, accel_range_m_s2=39.2
    ),
    rate_hz=100.0,
    std_gyro_bias=0.03,
    std_accel_bias=0.2,
)
UNITS = {"bmi160": BMI160, "consumer": CONSUMER}


def exact(path: Callable[[float], Array], cam_from_imu: Array, down: Array, t: float) -> tuple[Array, Array]:
    """Return angular rate and specific force (3,) at a time; `down` (3,): unit vector in the world of the path."""
    before, now, after = (path(t + k * _STEP_S) @ cam_from_imu for k in (-1, 0, 1))
    rate = se3.log_so3(before[:3, :3].T @ after[:3, :3]) / (2 * _STEP_S)
    acceleration = (before[:3, 3] - 2 * now[:3, 3] + after[:3, 3]) / _STEP_S**2
    return rate, now[:3, :3].T @ (acceleration - GRAVITY_M_S2 * down)


def measured(
    path: Callable[[float], Array],
    seconds: tuple[float, float],
    down: Array,
    unit: Unit = BMI160,
    seed: int = 0,
    start_ns: int = 0,
) -> ImuSamples:
    """Return the samples of a unit from one time of a path to another, `start_ns` being the stamp of time 0."""
    c, rng = unit.calibration, np.random.default_rng(seed)
    turned = c.cam_from_imu @ se3.exp(np.r_[np.zeros(3), unit.turned_rad])
    times = np.arange(np.ceil(seconds[0] * unit.rate_hz), seconds[1] * unit.rate_hz) / unit.rate_hz
    rows = np.array([np.r_[exact(path, turned, down, float(t))] for t in times])
    of_sensor = np.repeat([[c.gyro_noise, c.gyro_walk, unit.std_gyro_bias],
                           [c.accel_noise, c.accel_walk, unit.std_accel_bias]], 3, axis=0).T  # fmt: skip
    n = rows.shape
    walk = np.cumsum(rng.normal(size=n), axis=0) * of_sensor[1] / np.sqrt(unit.rate_hz)
    rows = rows + rng.normal(size=6) * of_sensor[2] + walk + rng.normal(size=n) * of_sensor[0] * np.sqrt(unit.rate_hz)
    ranges = np.repeat([c.gyro_range_rad_s, c.accel_range_m_s2], 3)
    rows = np.clip(rows, -ranges, ranges)
    jitter = rng.normal(size=len(times)) * unit.jitter_s
    stamps = start_ns + np.rint(1e9 * (times + unit.late_s + jitter)).astype(np.int64)
    return ImuSamples(stamps, rows[:, :3], rows[:, 3:])
