"""`inspect` checks the samples on their own, and compares them with the images of the first frames."""

import json

import pytest

import stream_sfm as sfm
from stream_sfm.logs.recording import inertial
from tests.helpers.imu_log import write_imu_log


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A log with the samples of a unit, and the same without."""
    return write_imu_log(tmp_path_factory.mktemp("imu"))[:2]


def changed(monkeypatch, change):
    """All samples as `change` makes them, or none where it gives None."""
    real = inertial.samples_of
    made = lambda *args: (found for m in real(*args) if (found := change(m)) is not None)  # noqa: E731
    monkeypatch.setattr("stream_sfm.inspection.unit_check.samples_of", made)


def test_a_sound_unit_is_described_without_a_warning(logs, cli):
    path, plain = logs
    found = json.loads(cli("inspect", path, "--json").out)
    assert not found["warnings"] and found["imu"]["topics"] == ["/imu"] and not found["imu"]["problem"]
    assert found["imu"]["rate_hz"] == pytest.approx(200) and found["imu"]["gap_count"] == 0
    assert found["imu"]["specific_force_m_s2"] == pytest.approx(9.81, abs=0.2)
    first = found["imu"]["first_frames"]
    assert first["frames"] == 11 and not first["findings"]
    assert abs(first["time_offset_s"]) < 3 * first["std_time_offset_s"]
    shown = cli("inspect", path).out
    assert "160 samples at 200 Hz, 0 gaps" in shown and "its clock" in shown and "biases" in shown
    assert json.loads(cli("inspect", plain, "--json").out)["imu"] is None


def test_gaps_and_other_units_are_reported(logs, monkeypatch):
    start = sfm.inspect(logs[0])["imu"]["samples"]
    changed(monkeypatch, lambda m: None if m.stamp_ns % 10**9 // 10**7 in (30, 31, 32, 33) else m)
    found = sfm.inspect(logs[0])
    assert found["imu"]["samples"] == start - 8 and found["imu"]["gap_count"] == 1
    assert found["imu"]["longest_gap_s"] == pytest.approx(0.045)
    assert any("1 gap between" in w and "the longest 0.045 s" in w for w in found["warnings"])
    changed(monkeypatch, lambda m: inertial.replace(m, accel_m_s2=m.accel_m_s2 / 9.81))
    found = sfm.inspect(logs[0])
    assert found["imu"]["problem"] and any("the IMU is not used" in w for w in found["warnings"])
    changed(monkeypatch, lambda _: None)
    assert "0 samples on /imu" in sfm.inspect(logs[0])["imu"]["problem"]


def test_a_refinement_says_what_samples_show(logs, tmp_path, cli):
    out = tmp_path / "refined.toml"
    found = json.loads(cli("refine", logs[0], "--out", out, "--json").out)
    assert found["logs"][0]["imu"] == []  # nothing is certain of an exact unit
    refined = sfm.StereoRig.from_calibration(out)
    assert refined.imu is not None and refined.imu.time_offset_s == 0
