"""What the samples of an inertial unit have told by the end of a run: the figures, and sentences about its errors."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..geometry.se3 import Array
from ..inertial.upright import Upright
from ..rig_model.estimate import CERTAIN
from ..types import InertialEstimate

# Of the 17 numbers of the state those that do not change during a run, each group zero or not as a whole.
SCALE, AXES, CLOCK = slice(12, 13), slice(13, 16), slice(16, 17)
_NOISY = 5.0  # times the densities of the data sheet: vibration, or other units


def fixed_error(last: InertialEstimate, group: slice) -> tuple[Array, Array, bool]:
    """Return one of the fixed errors (k,), its covariance (k, k), and whether it is certain not to be zero."""
    fixed = np.r_[np.zeros(SCALE.start), last.scale, last.axes_rad, last.time_offset_s]
    error, cov = fixed[group], last.cov[6:, 6:][group, group]
    return error, cov, bool(error @ np.linalg.pinv(cov) @ error > CERTAIN**2)


def inertial_findings(last: InertialEstimate) -> Iterator[str]:
    """Say what is certain of a unit: its clock, its axes, its noise, and the scale of the images that it shows."""
    for group, per_unit, sentence, words in (
        (
            CLOCK,
            1e3,
            "the clock of the IMU is {:.2f} ± {:.2f} ms {} that of the left camera",
            ("ahead of", "behind"),
        ),
        (AXES, 1e3, "the IMU is turned by {:.1f} ± {:.1f} mrad against its calibration", ("", "")),
        (SCALE, 100, "lengths by the images alone are {:.2f} ± {:.2f} % too {}", ("short", "long")),
    ):
        error, cov, certain = fixed_error(last, group)
        if certain:
            size = float(np.linalg.norm(error))
            std = float(np.sqrt(error @ cov @ error)) / size
            yield sentence.format(per_unit * size, per_unit * std, words[int(error[0] < 0)])
    for name, factor in zip(("gyroscope", "accelerometer"), last.densities, strict=True):
        if factor > _NOISY:
            yield f"the {name} has {factor:.0f} times the noise of its calibration: vibration, or other units?"
    if last.note:
        yield last.note


def describe_inertia(upright: Upright, last: InertialEstimate) -> dict[str, Any]:
    """Return the figures of summary.json by the latest estimate, and by where the world lies in an upright one."""
    std = np.sqrt(np.diag(last.cov))[6:]
    return {
        "up_in_world": upright.upright_from_world[2, :3].tolist(),
        "std_up_in_world_rad": upright.std_tilt_rad,
        "gravity_from_world": upright.upright_from_world.tolist(),
        "std_tilt_rad": last.std_tilt_rad,
        "gravity_m_s2": float(np.linalg.norm(last.gravity)),
        "gyro_bias_rad_s": last.gyro_bias.tolist(),
        "std_gyro_bias_rad_s": std[6:9].tolist(),
        "accel_bias_m_s2": last.accel_bias.tolist(),
        "std_accel_bias_m_s2": std[9:12].tolist(),
        "scale_percent": 100 * last.scale,
        "std_scale_percent": float(100 * std[12]),
        "axes_rad": last.axes_rad.tolist(),
        "std_axes_rad": std[AXES].tolist(),
        "time_offset_s": last.time_offset_s,
        "std_time_offset_s": float(std[16]),
        "densities_over_data_sheet": last.densities.tolist(),
        "findings": list(inertial_findings(last)),
    }


def _axes(values: list[float], per_unit: float) -> str:
    return f"({', '.join(f'{per_unit * x:+.2f}' for x in values)})"


def inertial_rows(imu: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the rows of a table about what the samples of an inertial unit have told."""
    yield "inertia", f"{imu['frames']} frames, {imu['dead_reckoned']} of them by the IMU alone"
    tilt, lengths = 1e3 * imu["std_tilt_rad"], imu["std_scale_percent"]
    yield "", f"tilt σ {tilt:.2g} mrad, lengths {imu['scale_percent']:+.2f} %, σ {lengths:.2g} %"
    offset_ms, std_ms = 1e3 * imu["time_offset_s"], 1e3 * imu["std_time_offset_s"]
    yield "", f"its clock {offset_ms:+.2f} ms, σ {std_ms:.2g} ms"
    std_axes = 1e3 * max(imu["std_axes_rad"])
    yield "", f"its axes {_axes(imu['axes_rad'], 1e3)} mrad, σ {std_axes:.2g} mrad"
    yield "", f"biases {_axes(imu['gyro_bias_rad_s'], 1e3)} mrad/s, {_axes(imu['accel_bias_m_s2'], 1e3)} mm/s²"
    gyro, accel = imu["densities_over_data_sheet"]
    yield "", f"its noise × {gyro:.2g} (gyroscope) and × {accel:.2g} (accelerometer) of the data sheet"
