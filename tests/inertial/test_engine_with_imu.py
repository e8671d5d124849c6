"""An engine with inertial samples: the same live and replayed, better than without, and never wrong by bad samples."""

import copy
from dataclasses import replace

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.geometry import se3
from stream_sfm.inertial.samples import ImuCalibration, ImuSamples
from tests.helpers.wall import PERIOD_NS, Wall, rig
from tools.render.inertial import BMI160, measured

N = 30
STEP = np.array([0.012, 0.002, 0.008, 0.002, -0.004, 0.003])
DOWN = np.array([0.0, 1.0, 0.0])
RIG = replace(rig(0.03), imu=BMI160.calibration)
CONFIG = sfm.Config()


def path(t: float) -> np.ndarray:
    wave = 0.05 * np.sin(2 * np.pi * np.array([0.9, 1.3, 0.7]) * t)
    return se3.exp(STEP * t / 0.05) @ se3.exp(np.r_[wave - wave * 0, 0.3 * wave])


def moment(t: float) -> np.ndarray:
    return se3.inverse(path(0.0)) @ path(t)


@pytest.fixture(scope="module")
def frames():
    poses = np.array([moment(k * 0.05) for k in range(N)])
    return [replace(f, stamp_ns=f.stamp_ns + 10**9) for f in Wall(5).frames(RIG, poses)], poses


@pytest.fixture(scope="module")
def samples():
    return measured(moment, (-0.2, N * 0.05), DOWN, seed=3, start_ns=10**9)


def with_samples(frames, samples: ImuSamples):
    last = -1
    for frame in frames:
        upto = np.searchsorted(samples.stamps_ns, frame.stamp_ns, side="right") + 1
        first = np.searchsorted(samples.stamps_ns, last, side="right")
        last = samples.stamps_ns[min(upto, len(samples)) - 1]
        yield replace(frame, imu=samples[first:upto])


def run(frames, stereo=RIG, config=CONFIG):
    engine = sfm.Engine(stereo, config)
    return [engine.step(frame) for frame in frames]


def bytes_of(estimates) -> bytes:
    return b"".join(e.world_from_cam.tobytes() + e.cov_pose.tobytes() for e in estimates)


def rotation_error(estimates, poses) -> float:
    apart = [se3.log(se3.inverse(e.world_from_cam) @ p)[3:] for e, p in zip(estimates, poses, strict=True)]
    return float(np.sqrt(np.mean(np.square(apart))))


def test_without_samples_a_calibrated_unit_changes_nothing(frames):
    images, _ = frames
    assert bytes_of(run(images[:12])) == bytes_of(run(images[:12], replace(RIG, imu=None)))


def test_samples_that_are_switched_off_change_nothing(frames, samples):
    images, _ = frames
    off = sfm.read_config(None, ["imu.enabled=false"])
    assert bytes_of(run(images[:12])) == bytes_of(run(with_samples(images[:12], samples), config=off))


def test_samples_make_it_better_and_say_what_is_down(frames, samples):
    images, poses = frames
    without, with_imu = run(images), run(with_samples(images, samples))
    assert all(e.status == sfm.Status.OK for e in with_imu[1:])
    assert rotation_error(with_imu, poses) < max(rotation_error(without, poses), 1.5e-4)  # a wall shows it to 0.1 mrad
    last = with_imu[-1].inertial
    tilt = np.linalg.norm(np.cross(last.gravity / np.linalg.norm(last.gravity), poses[-1][:3, :3].T @ DOWN))
    assert tilt < 4 * last.std_tilt_rad and last.std_tilt_rad < 0.05
    velocity = (moment((N - 1) * 0.05 + 1e-4)[:3, 3] - moment((N - 1) * 0.05 - 1e-4)[:3, 3]) / 2e-4
    error = last.velocity - poses[-1][:3, :3].T @ velocity
    assert error @ np.linalg.solve(last.cov[6:9, 6:9], error) < 25


def test_a_driver_and_frames_that_carry_their_samples_give_the_same_bytes(frames, samples):
    images, _ = frames
    engine, live, given = sfm.Engine(RIG, CONFIG), [], 0
    for image in images[:15]:
        while given < len(samples) and samples.stamps_ns[given] < image.stamp_ns + 7_000_000:
            row = samples.stamps_ns[given], samples.gyro_rad_s[given], samples.accel_m_s2[given]
            engine.add_imu(int(row[0]), *row[1:])
            given += 1
        live.append(engine.step(image))
        engine.predict(image.stamp_ns + 5_000_000)  # which changes nothing
    assert bytes_of(live) == bytes_of(run(with_samples(images[:15], samples)))


def test_an_engine_goes_on_from_a_copy(frames, samples):
    images = list(with_samples(frames[0][:14], samples))
    engine = sfm.Engine(RIG, CONFIG)
    for image in images[:8]:
        engine.step(image)
    other = copy.deepcopy(engine)
    first, second = [[e.step(image) for image in images[8:]] for e in (engine, other)]
    assert bytes_of(first) == bytes_of(second)


def test_darkness_is_bridged_within_sigma(frames, samples):
    images, poses = frames
    dark = [replace(f, left=0 * f.left, right=0 * f.right) if 16 <= k < 24 else f for k, f in enumerate(images)]
    estimates = run(with_samples(dark, samples))
    assert all("dead-reckoned" in e.reason and e.inertial.dead_reckoned for e in estimates[16:24])
    for estimate, pose in zip(estimates[16:], poses[16:], strict=True):
        error = se3.log(se3.inverse(estimate.world_from_cam) @ pose)
        assert error @ np.linalg.solve(estimate.cov_pose, error) < 36
        assert np.linalg.norm(error[:3]) < 0.02


def test_the_state_is_where_the_pose_is_reported(frames, samples):
    """What leads on from the latest frame begins at its pose."""
    engine = sfm.Engine(RIG, CONFIG)
    estimates = [engine.step(frame) for frame in with_samples(frames[0], samples)]
    now = engine.predict(estimates[-1].stamp_ns)
    assert now is not None
    assert now.world_from_cam == pytest.approx(estimates[-1].world_from_cam, abs=1e-9)


def test_predictions_at_the_rate_of_the_samples(frames, samples):
    images, _ = frames
    engine = sfm.Engine(RIG, CONFIG)
    for image in with_samples(images[:20], samples):
        engine.step(image)
    at_ns = images[20].stamp_ns
    later = (samples.stamps_ns > images[19].stamp_ns) & (samples.stamps_ns <= at_ns + 5_000_000)
    for row in np.flatnonzero(later):
        engine.add_imu(int(samples.stamps_ns[row]), samples.gyro_rad_s[row], samples.accel_m_s2[row])
    found = engine.predict(at_ns)
    error = se3.log(se3.inverse(found.world_from_cam) @ moment(20 * 0.05))
    assert np.linalg.norm(error[:3]) < 0.01 and error @ np.linalg.solve(found.cov_pose, error) < 36
    assert sfm.Engine(RIG, CONFIG).predict(at_ns) is None


def changed_by(samples: ImuSamples, how: str) -> ImuSamples:
    stamps, gyro, accel = samples.stamps_ns.copy(), samples.gyro_rad_s.copy(), samples.accel_m_s2.copy()
    rng, rows = np.random.default_rng(1), np.ones(len(samples), bool)
    if how == "gap":
        rows[140:160] = False
    if how == "saturated":
        gyro = np.clip(gyro, -0.1, 0.1)
    if how == "half the rate":
        rows[1::2] = False
    if how == "jitter":
        stamps = np.sort(stamps + np.rint(rng.normal(0, 2e6, len(stamps))).astype(np.int64))
    if how == "degrees":
        gyro = np.rad2deg(gyro)
    if how == "other axes":
        gyro, accel = gyro[:, [1, 2, 0]], accel[:, [1, 2, 0]]
    if how == "no gravity":
        accel = accel - accel.mean(axis=0)
    if how == "a shock":
        accel[150:156] += 60.0
    return ImuSamples(stamps[rows], gyro[rows], accel[rows])


@pytest.mark.parametrize(
    "how", ["gap", "saturated", "half the rate", "jitter", "degrees", "other axes", "no gravity", "a shock"]
)
def test_bad_samples_never_make_a_wrong_frame_ok(frames, samples, how):
    images, poses = frames
    unit = replace(BMI160.calibration, gyro_range_rad_s=0.1) if how == "saturated" else BMI160.calibration
    estimates = run(with_samples(images, changed_by(samples, how)), replace(RIG, imu=unit))
    for estimate, pose in zip(estimates, poses, strict=True):
        error = se3.log(se3.inverse(estimate.world_from_cam) @ pose)
        distance2 = error @ np.linalg.solve(estimate.cov_pose + 1e-12 * np.eye(6), error)
        assert estimate.status != sfm.Status.OK or distance2 < 36, (how, estimate, distance2)


def test_samples_of_another_kind_are_refused(frames):
    with pytest.raises(sfm.FrameError, match="ImuSamples"):
        sfm.Engine(RIG).step(replace(frames[0][0], imu=[1, 2, 3]))
    assert PERIOD_NS == 50_000_000 and isinstance(RIG.imu, ImuCalibration)
