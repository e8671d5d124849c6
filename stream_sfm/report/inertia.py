"""The findings of a run about its inertial unit: figures, and sentences about its errors."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..geometry import Array
from ..inertial.state import ACCEL_BIAS, AXES, CLOCK, FIXED, GYRO_BIAS, SCALE
from ..inertial.upright import Upright
from ..rig_model.estimate import in_words, is_certain
from ..types import InertialEstimate

# Quantities that are constant during a run: place in the state, unit, and the sentence about a certain error.
_FINDINGS = (
    (CLOCK, 1e3, "the clock of the IMU is {:.2f} ± {:.2f} ms {} that of the left camera", ("ahead of", "behind")),
    (AXES, 1e3, "the IMU is turned by {:.1f} ± {:.1f} mrad against its calibration", ("", "")),
    (SCALE, 100, "lengths by the images alone are {:.2f} ± {:.2f} % too {}", ("short", "long")),
)


def fixed_error(last: InertialEstimate, part: slice) -> tuple[Array, Array]:
    """Return one of the constant errors, scale, axes or clock (k,), and its covariance (k, k)."""
    fixed = np.r_[np.zeros(FIXED.start), last.scale, last.axes_rad, last.time_offset_s]
    return fixed[part], last.cov_of(part)


def inertial_findings(last: InertialEstimate) -> Iterator[str]:
    """Say what is certain about a unit: its clock, its axes, its noise, and the scale of lengths from images."""
    for part, per_unit, sentence, words in _FINDINGS:
        error, cov = fixed_error(last, part)
        if is_certain(error, cov):
            yield in_words(error, cov, per_unit, sentence, words)
    for name, factor in zip(("gyroscope", "accelerometer"), last.densities, strict=True):
        if factor > 5:  # vibration, or other units
            yield f"the {name} has {factor:.0f} times the noise of its calibration: vibration, or other units?"
    if last.note:
        yield last.note


def describe_inertia(upright: Upright, last: InertialEstimate) -> dict[str, Any]:
    """Return the figures of summary.json from the latest estimate and from the orientation of the world."""
    std = np.sqrt(np.diag(last.cov))[6:]
    return {
        "up_in_world": upright.upright_from_world[2, :3].tolist(),
        "std_up_in_world_rad": upright.std_tilt_rad,
        "gravity_from_world": upright.upright_from_world.tolist(),
        "std_tilt_rad": last.std_tilt_rad,
        "gravity_m_s2": float(np.linalg.norm(last.gravity)),
        "gyro_bias_rad_s": last.gyro_bias.tolist(),
        "std_gyro_bias_rad_s": std[GYRO_BIAS].tolist(),
        "accel_bias_m_s2": last.accel_bias.tolist(),
        "std_accel_bias_m_s2": std[ACCEL_BIAS].tolist(),
        "scale_percent": 100 * last.scale,
        "std_scale_percent": float(100 * std[SCALE][0]),
        "axes_rad": last.axes_rad.tolist(),
        "std_axes_rad": std[AXES].tolist(),
        "time_offset_s": last.time_offset_s,
        "std_time_offset_s": float(std[CLOCK][0]),
        "densities_over_data_sheet": last.densities.tolist(),
        "findings": list(inertial_findings(last)),
    }


def _axes(values: list[float], per_unit: float) -> str:
    return f"({', '.join(f'{per_unit * x:+.2f}' for x in values)})"


def inertial_rows(imu: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the rows of a table about the findings from the samples of an inertial unit."""
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
