"""Certain findings of samples go into a calibration: clock and axes of their unit, and the baseline."""

from dataclasses import replace

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from stream_sfm.inertial.samples import ImuSamples
from stream_sfm.report.inertia import inertial_findings
from stream_sfm.run.refine import with_unit
from stream_sfm.types import InertialEstimate
from tests.inertial.test_engine_with_imu import RIG, N, frames, run, samples, with_samples

__all__ = ["frames", "samples"]  # fixtures
OFFSET_S, AXES_RAD = 0.02, np.array([0.0, 0.0, 0.08])


def estimate(
    scale: float = 0.0, axes_rad: tuple[float, ...] | np.ndarray = (0.0, 0.0, 0.0), offset_s: float = 0.0
) -> InertialEstimate:
    """An estimate with a σ of 1 mm per metre, 1 mrad, and 0.1 ms."""
    cov = np.diag(np.r_[np.full(18, 1e-6), 1e-3, np.full(3, 1e-3), 1e-4] ** 2)
    zero, down = np.zeros(3), np.array([0.0, 9.81, 0.0])
    return InertialEstimate(zero, down, zero, zero, scale, np.array(axes_rad), offset_s, cov, np.ones(2))


def test_what_is_certain_is_corrected_and_nothing_else():
    assert with_unit(RIG, [estimate(2e-3, 2e-3 * np.ones(3), 2e-4)]).to_toml() == RIG.to_toml()
    assert not list(inertial_findings(estimate()))
    runs = [estimate(0.02, AXES_RAD, OFFSET_S), estimate(0.022, AXES_RAD, OFFSET_S), estimate()]
    found = with_unit(RIG, runs)
    assert found.baseline_m == pytest.approx(1.021 * RIG.baseline_m)
    assert found.imu.time_offset_s == pytest.approx(RIG.imu.time_offset_s + OFFSET_S)
    turned = se3.log_so3(RIG.imu.cam_from_imu[:3, :3].T @ found.imu.cam_from_imu[:3, :3])
    assert np.allclose(turned, AXES_RAD)
    assert np.array_equal(found.imu.cam_from_imu[:3, 3], RIG.imu.cam_from_imu[:3, 3])
    assert [said.split(" by ")[0] for said in inertial_findings(runs[0])] == [
        "the clock of the IMU is 20.00 ± 0.10 ms ahead of that of the left camera",
        "the IMU is turned",
        "lengths",
    ]


def test_a_refined_calibration_read_back_leaves_nothing_to_find(frames, samples):
    """A clock that is 20 ms ahead and a unit that is turned by 80 mrad: the signs are those that a replay takes."""
    images, _ = frames
    turned = RIG.imu.cam_from_imu @ se3.exp(np.r_[0, 0, 0, -AXES_RAD])
    wrong = replace(RIG, imu=replace(RIG.imu, cam_from_imu=turned))
    late = ImuSamples(samples.stamps_ns + round(OFFSET_S * 1e9), samples.gyro_rad_s, samples.accel_m_s2)
    wide = sfm.read_config(None, ["imu.std_time_offset_s=0.02", "imu.std_axes_rad=0.1"])
    before = run(with_samples(images, late), wrong, wide)[-1].inertial
    refined = with_unit(wrong, [before])
    read = sfm.StereoRig.parse_calibration(refined.to_toml().encode(), "calibration.toml")
    after = run(with_samples(images, late), read, wide)[-1].inertial
    for size in (lambda e: abs(e.time_offset_s), lambda e: np.linalg.norm(e.axes_rad)):
        assert size(before) > 5 * size(after), (before, after)
    assert len(images) == N
