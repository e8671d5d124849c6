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
