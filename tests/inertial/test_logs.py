"""Samples of logs reach their frames, and calibrations of other programs say where the unit is."""

import json
from dataclasses import replace

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from stream_sfm.report.numbers import numbers
from stream_sfm.report.pages import render_comparison, render_log
from stream_sfm.run.compare import compared_on
from tests.helpers.imu_log import write_imu_log
from tests.helpers.wall import rig
from tools.render.inertial import BMI160

CAM_FROM_IMU = BMI160.calibration.cam_from_imu
RATE_NS = 5_000_000


@pytest.fixture(scope="module")
def imu_log(tmp_path_factory):
    """A log with the samples of a unit, and the same without."""
    return write_imu_log(tmp_path_factory.mktemp("imu"))


def test_each_frame_has_its_samples_and_one_beyond(imu_log):
    path, _, samples = imu_log
    log = sfm.open_log(path)
    assert not log.imu_problem and np.allclose(log.stereo_rig.imu.cam_from_imu, CAM_FROM_IMU, atol=1e-9)
    frames = list(log.frames())
    given = np.concatenate([f.imu.stamps_ns for f in frames])
    assert (np.diff(given) == RATE_NS).all()
    for frame in frames:
        assert (frame.imu.stamps_ns > frame.stamp_ns).sum() == 1
    row = np.searchsorted(samples.stamps_ns, given[3])
    assert np.allclose(frames[0].imu.gyro_rad_s[3], samples.gyro_rad_s[row])


def test_a_replay_uses_them_unless_told_not_to(imu_log, tmp_path):
    path, plain, _ = imu_log
    result = sfm.replay(path, tmp_path / "with")
    assert result.summary["imu"]["frames"] == 12 - 1
    estimates = list(sfm.read_results(tmp_path / "with").estimates())
    assert np.isfinite(estimates[-1].inertial.cov).all() and len(estimates[-1].inertial.velocity) == 3
    off = sfm.read_config(None, ["imu.enabled=false"])
    sfm.replay(path, tmp_path / "off", off)
    sfm.replay(plain, tmp_path / "plain", off)
    names = ("trajectory.tum", "trajectory.csv")
    assert all((tmp_path / "off" / n).read_bytes() == (tmp_path / "plain" / n).read_bytes() for n in names)
    assert json.loads((tmp_path / "off/summary.json").read_bytes())["imu"] is None


def test_a_unit_that_is_nowhere_is_reported_and_not_used(imu_log, monkeypatch):
    monkeypatch.setattr("stream_sfm.logs.recording.inertial.fixed_transform", lambda *_: None)
    log = sfm.open_log(imu_log[0])
    assert "no fixed transform" in log.imu_problem and log.stereo_rig.imu is None
    assert next(log.frames()).imu is None


def test_our_own_calibration_is_read_back_unchanged():
    given = replace(rig(), imu=sfm.ImuCalibration(CAM_FROM_IMU, gyro_noise=1e-3, time_offset_s=0.002))
    read = sfm.StereoRig.parse_calibration(given.to_toml().encode(), "calibration.toml")
    assert np.allclose(read.imu.cam_from_imu, CAM_FROM_IMU) and read.imu.gyro_noise == 1e-3
    assert read.imu.time_offset_s == 0.002 and read.to_toml() == given.to_toml()
    with pytest.raises(sfm.ConfigError, match="cam_from_imu"):
        sfm.StereoRig.parse_calibration((rig().to_toml() + "\n[imu]\ngyro_noise = 1e-3\n").encode(), "c.toml")


def camera(key: str, pose: np.ndarray, right: bool) -> str:
    moved = pose if not right else se3.inverse(rig().right_from_left) @ pose
    rows = "\n".join(f"  - {row}" for row in moved.tolist())
    return f"""
  camera_model: pinhole
  intrinsics: [260.0, 260.0, 159.5, 119.5]
  distortion_model: radtan
  distortion_coeffs: [0, 0, 0, 0]
  resolution: [320, 240]
  timeshift_cam_imu: 0.004
  {key}:
{rows}
"""


@pytest.mark.parametrize("key", ["T_cam_imu", "T_imu_cam"])
def test_chains_of_kalibr_and_openvins_with_the_noise_beside(tmp_path, key):
    poses = [CAM_FROM_IMU, rig().right_from_left @ CAM_FROM_IMU]
    poses = poses if key == "T_cam_imu" else [se3.inverse(p) for p in poses]
    chain = "".join(f"cam{n}:{camera(key, pose, False)}" for n, pose in enumerate(poses))
    (tmp_path / "camchain.yaml").write_text(chain)
    (tmp_path / "imu.yaml").write_text("imu0:\n  accelerometer_noise_density: 0.02\n  gyroscope_noise_density: 0.001\n")
    for where in (tmp_path, [tmp_path / "camchain.yaml", tmp_path / "imu.yaml"]):
        found = sfm.StereoRig.from_calibration(where)
        assert np.allclose(found.imu.cam_from_imu, CAM_FROM_IMU, atol=1e-9) and found.imu.accel_noise == 0.02
        assert found.imu.time_offset_s == 0.004 and found.baseline_m == pytest.approx(0.2)


def test_a_comparison_runs_the_window_without_samples_too(imu_log):
    path, plain, _ = imu_log
    log = sfm.open_log(path)
    assert compared_on(log, sfm.Config())[:2] == ("cross-frame", "cross-frame-no-imu")
    assert compared_on(sfm.open_log(plain), sfm.Config()) == compared_on(
        log, sfm.read_config(None, ["imu.enabled=false"])
    )
    methods = ("cross-frame", "cross-frame-no-imu", "iterated-ekf", "ekf", "ekf-cv")
    both, without = (sfm.compare(at, methods=methods).comparison for at in (log, plain))
    run = {record.name: record for record in both.runs}
    assert run["cross-frame"].inertial() is not None and run["cross-frame-no-imu"].inertial() is None
    assert not np.array_equal(run["cross-frame"].poses, run["cross-frame-no-imu"].poses)
    assert all(record.inertial() is None for record in without.runs)
    alike = {record.name: record.poses for record in without.runs}
    assert np.array_equal(alike["cross-frame"], alike["cross-frame-no-imu"])
    assert run["iterated-ekf"].inertial() is not None and run["ekf"].inertial() is not None
    assert run["ekf-cv"].inertial() is None
    used_by = "cross-frame, iterated EKF with plain weights and EKF with plain weights"
    said = f"Inertial samples are used by {used_by}, and by no other method here."
    for found, shown in ((both, True), (without, False)):
        page = render_comparison(found, numbers(found))
        assert (said in page) == ("Inertial samples" in page) == shown


@pytest.mark.parametrize("method", ["cross-frame-no-imu", "ekf-cv"])
def test_a_method_without_samples_takes_none_where_it_runs_alone_either(imu_log, method):
    """Not with a frame, and not ahead of it, where a front-end asks for the motion that they predict."""
    log, runs = sfm.open_log(imu_log[0]), []
    for switched_off in ([], ["imu.enabled=false"]):
        engine = sfm.Engine(log.rig, sfm.read_config(None, [f'method="{method}"', *switched_off]))
        runs.append([engine.step(frame) for frame in log.frames()])
    assert all(e.inertial is None for e in runs[0])
    for one, other in zip(*runs, strict=True):
        assert np.array_equal(one.world_from_cam, other.world_from_cam)
        assert np.array_equal(one.cov_pose, other.cov_pose)


def test_the_page_of_a_log_says_what_its_samples_told(imu_log, tmp_path):
    for log, told in zip(imu_log[:2], (True, False), strict=True):
        result = sfm.replay(log, tmp_path / log.stem)
        summary = json.loads((result.out_dir / "summary.json").read_bytes())
        row = {"name": log.stem, "log": str(log), "status": "done", "reason": "", "summary": summary}
        page = render_log(row, result.out_dir)
        assert ("<h2>Inertia</h2>" in page) == told == ("11 frames, 0 of them by the IMU alone" in page)
