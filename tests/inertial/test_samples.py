"""Faulty samples lead to a note, a larger covariance, or an error in words."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stream_sfm.errors import ConfigError, FrameError
from stream_sfm.inertial.buffer import SampleBuffer
from stream_sfm.inertial.driver import DriverSamples
from stream_sfm.inertial.samples import ImuCalibration, ImuSamples
from tests.helpers.imu_views import swaying
from tools.render.inertial import BMI160, CONSUMER, measured

MS = 1_000_000
REST = np.array([0.0, -9.81, 0.0])


def samples(n: int = 200, period_ms: float = 5.0, gyro=0.1, accel=REST) -> ImuSamples:
    rng = np.random.default_rng(0)
    stamps = np.rint(np.arange(n) * period_ms * MS).astype(np.int64)
    noise = rng.normal(0, 1e-3, (2, n, 3))
    return ImuSamples(stamps, gyro + noise[0], np.asarray(accel) + noise[1])


def buffer_of(given: ImuSamples, **calibration) -> SampleBuffer:
    buffer = SampleBuffer(ImuCalibration(**calibration))
    buffer.add(given)
    return buffer


def test_an_interval_has_its_ends_and_all_samples_between():
    found = buffer_of(samples()).between(101 * MS, 151 * MS, 0.0)
    assert found.seconds[0] == 0 and found.seconds[-1] == pytest.approx(0.05) and len(found.seconds) == 12
    assert (found.widened == 1).all() and found.complete and not found.note


def test_a_gap_widens_the_interval_and_is_reported():
    given = samples()
    buffer = buffer_of(given[np.r_[0:20, 40:200]])
    found = buffer.between(50 * MS, 250 * MS, 0.0)
    assert found.widened.max() > 1e4 and "missing" in found.note
    assert (buffer.between(250 * MS, 300 * MS, 0.0).widened == 1).all()


def test_samples_that_end_too_soon_hold_and_are_widened():
    found = buffer_of(samples(n=100)).between(450 * MS, 540 * MS, 0.0)
    assert not found.complete and found.widened[-1] > 1e4 and found.seconds[-1] == pytest.approx(0.09)


def test_samples_at_the_end_of_their_range_are_reported():
    given = samples()
    clipped = given.gyro_rad_s.copy()
    clipped[50:60, 1] = 4.36
    buffer = buffer_of(ImuSamples(given.stamps_ns, clipped, given.accel_m_s2))
    found = buffer.between(240 * MS, 310 * MS, 0.0)
    assert "saturated" in found.note and found.widened.max() >= 1e4
    beyond = buffer_of(samples(gyro=40.0)).between(100 * MS, 150 * MS, 0.0)
    assert "saturated" in beyond.note


def test_stamps_backwards_and_numbers_that_are_none_are_left_out():
    given = samples()
    stamps, gyro = given.stamps_ns.copy(), given.gyro_rad_s.copy()
    stamps[30], gyro[60, 0] = stamps[10], np.nan
    buffer = buffer_of(ImuSamples(stamps, gyro, given.accel_m_s2))
    assert buffer.counts["backwards"] == 1 and buffer.counts["no measurement"] == 1
    assert np.isfinite(buffer.between(100 * MS, 400 * MS, 0.0).gyro).all()


@pytest.mark.parametrize("ahead_ms", [50, 1000, 3_600_000])
@pytest.mark.parametrize("batches", [(0, 200), (0, 30, 200), (0, 31, 200), (0, 32, 200)])
def test_one_stamp_ahead_hides_no_sample_that_follows(ahead_ms, batches):
    given = samples()
    stamps = given.stamps_ns.copy()
    stamps[30] += ahead_ms * MS
    buffer = buffer_of(given[:0])
    for first, end in pairwise(batches):
        buffer.add(ImuSamples(stamps, given.gyro_rad_s, given.accel_m_s2)[first:end])
    assert buffer.last_ns == given.stamps_ns[-1] and buffer.counts["backwards"] == 1
    found = buffer.between(201 * MS, 251 * MS, 0.0)
    assert found.complete and not found.note and len(found.seconds) == 12


def test_a_driver_gives_what_follows_a_stamp_ahead():
    driver, given = DriverSamples(), samples(n=21)
    for k, stamp_ns in enumerate(given.stamps_ns.tolist()):
        driver.add(stamp_ns + 10**12 * (k == 5), given.gyro_rad_s[k], given.accel_m_s2[k])
    assert len(driver.take_until(50 * MS)) == 12  # up to 50 ms, and one beyond
    with pytest.raises(FrameError, match="64 bits"):
        driver.add(2**63, np.zeros(3), REST)


def test_the_same_samples_count_once():
    buffer = buffer_of(samples())
    before = buffer.between(100 * MS, 150 * MS, 0.0)
    buffer.add(samples())
    assert (buffer.between(100 * MS, 150 * MS, 0.0).gyro == before.gyro).all()


@pytest.mark.parametrize(
    ("accel", "gyro", "said"),
    [(REST / 9.81, 0.1, "g:"), (0 * REST, 0.1, "gravity"), (REST, 60.0, "degrees"), (1000 * REST, 0.1, "m/s²")],
)
def test_other_units_are_reported_and_nothing_is_used(accel, gyro, said):
    assert said in buffer_of(samples(accel=accel, gyro=gyro)).problem
    assert not buffer_of(samples()).problem


def test_a_calibrated_offset_is_that_of_the_unit_beyond_the_camera():
    late = buffer_of(samples(), time_offset_s=0.005)
    assert late.last_ns == 199 * 5 * MS - 5 * MS


@pytest.mark.parametrize("wrong", [([0.5], [[0] * 3], [[0] * 3]), ([1, 2], [[0] * 3], [[0] * 3]), ("a", "b", "c")])
def test_arrays_of_other_shapes_are_refused(wrong):
    with pytest.raises(FrameError, match="stamps_ns"):
        ImuSamples(*wrong)


def test_a_unit_that_cannot_be_is_refused():
    with pytest.raises(ConfigError, match="4×4"):
        ImuCalibration(np.zeros((4, 4)))
    with pytest.raises(ConfigError, match="gyro_noise"):
        ImuCalibration(gyro_noise=-1.0)


def test_a_driver_gives_each_frame_its_own_and_one_beyond():
    driver = DriverSamples()
    for k in range(10):
        driver.add(5 * MS * k, [0, 0, 0.1], REST)
    assert driver.take_until(12 * MS).stamps_ns.tolist() == [0, 5 * MS, 10 * MS, 15 * MS]
    assert driver.take_until(25 * MS).stamps_ns.tolist() == [20 * MS, 25 * MS, 30 * MS]
    with pytest.raises(FrameError, match="inertial sample"):
        driver.add(1.5, [0, 0, 0], REST)


@pytest.mark.parametrize("unit", [BMI160, CONSUMER])
def test_samples_of_a_moving_unit_tell_its_noise_by_themselves(unit):
    path = swaying(3)
    given = measured(path, (0.0, 1.0), path.down, unit, seed=3)
    wrong = replace(unit.calibration, gyro_noise=1e-5, accel_noise=1.0)  # not asked
    buffer = SampleBuffer(wrong)
    buffer.add(given[:29])
    assert buffer.noise() is None
    buffer.add(given)
    assert buffer.noise() == pytest.approx([unit.calibration.gyro_noise, unit.calibration.accel_noise], rel=0.3)
