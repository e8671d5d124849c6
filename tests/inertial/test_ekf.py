"""The filterpy EKF with inertial samples: its transition against differences, its covariance against its errors."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import read_config
from stream_sfm.estimators.window.inertia.interval import Interval, Transition, transition
from stream_sfm.geometry import se3
from stream_sfm.inertial.buffer import SampleBuffer
from stream_sfm.inertial.samples import ImuSamples
from stream_sfm.inertial.state import GRAVITY, GYRO_BIAS, VELOCITY
from stream_sfm.simulation.scenes import FRAME_NS, Motion, Scene, rectified_projection
from stream_sfm.types import InertialView, Observations, Status
from tests.helpers.estimators import nees, run, without_views
from tools.render.inertial import BMI160, GRAVITY_M_S2, measured

FRAMES = 25
STEP = np.array([0.03, 0, 0, 0, -0.02, 0])
DOWN = np.array([0.0, 1.0, 0.0])
CONFIG = read_config(None, ["rig.exact=true"])
UNIT = BMI160.calibration


def path(t_s: float) -> np.ndarray:
    return se3.exp(STEP * t_s * 1e9 / FRAME_NS)


def trial(seed: int) -> tuple[np.ndarray, list[Observations], list[Observations]]:
    """True poses, and observations with and without samples."""
    sequence = Scene(frames=FRAMES, motion=Motion(STEP[0], -STEP[4]), density=40, std_px=0.3).sequence(
        np.random.SeedSequence(seed)
    )
    start_ns = sequence.observations[0].stamp_ns
    samples = measured(path, (-0.2, FRAMES * FRAME_NS / 1e9), DOWN, seed=seed, start_ns=start_ns)
    with_samples, done = [], 0
    for o in sequence.observations:
        upto = int(np.searchsorted(samples.stamps_ns, o.stamp_ns, side="right")) + 1
        with_samples.append(replace(o, inertial=InertialView(samples[done:upto], UNIT)))
        done = upto
    return sequence.world_from_cam, with_samples, list(sequence.observations)


def test_the_transition_equals_differences():
    stamps = np.arange(-20, 140, 5) * 1_000_000
    rng = np.random.default_rng(3)
    buffer = SampleBuffer(UNIT)
    buffer.add(ImuSamples(stamps, rng.normal(0, 0.3, (len(stamps), 3)), rng.normal([0, 9.8, 0], 1, (len(stamps), 3))))
    state = np.r_[0.4, -0.3, 0.8, 0.5, 9.7, 1.0, rng.normal(0, 0.01, 6), 0.01, 0.02, -0.01, 0.03, 1e-3]
    interval = Interval.of(buffer.between(0, 100_000_000, 1e-3), UNIT, state, np.ones(3))

    def moved(d: np.ndarray) -> Transition:
        return transition(state + d[6:], interval, np.ones(3), UNIT.cam_from_imu)

    base = moved(np.zeros(23))

    def end(d: np.ndarray) -> np.ndarray:
        found = moved(d)
        pose = se3.exp(d[:6]) @ found.previous_from_now
        return np.r_[se3.log(se3.inverse(base.previous_from_now) @ pose), found.state - base.state]

    numerical = np.stack([(end(d) - end(-d)) / 2e-6 for d in 1e-6 * np.eye(23)], axis=1)
    assert np.abs(base.rows - numerical).max() < 2e-3 * np.abs(numerical).max()


def test_the_covariance_is_that_of_the_errors():
    """Of 16 runs the mean NEES of the last pose lies within three standard errors, of the tilt too."""
    of_pose, of_tilt = [], []
    for seed in range(16):
        true, with_samples, _ = trial(seed)
        last = run("ekf", rectified_projection(), with_samples, CONFIG)[-1]
        of_pose.append(nees(last.world_from_cam, last.cov_pose, true[-1]))
        apart = last.inertial.gravity - GRAVITY_M_S2 * true[-1][:3, :3].T @ DOWN
        of_tilt.append(apart @ np.linalg.solve(last.inertial.cov_of(GRAVITY), apart))
    for values, dof in ((of_pose, 6), (of_tilt, 3)):
        assert np.mean(values) == pytest.approx(dof, abs=3 * np.sqrt(2 * dof / 16))


def test_samples_make_it_better():
    squares = np.zeros(2)
    for seed in range(100, 106):
        true, *both = trial(seed)
        for k, observations in enumerate(both):
            last = run("ekf", rectified_projection(), observations, CONFIG)[-1]
            squares[k] += np.sum(se3.log(se3.inverse(last.world_from_cam) @ true[-1])[3:] ** 2)
    assert squares[0] < 0.5 * squares[1]


def test_it_goes_on_in_the_dark():
    """Without views for half a second samples carry pose and state, within four σ."""
    true, with_samples, _ = trial(7)
    dark = [without_views(o) if 12 <= k < 17 else o for k, o in enumerate(with_samples)]
    solutions = run("ekf", rectified_projection(), dark, CONFIG)
    assert all(s.status is Status.DEGRADED and s.inertial.dead_reckoned for s in solutions[12:17])
    assert solutions[-1].status is Status.OK
    for k in (14, 16, 18, -1):
        assert nees(solutions[k].world_from_cam, solutions[k].cov_pose, true[k]) < 6 + 4 * np.sqrt(12) + 4
    assert solutions[-1].inertial.cov_of(VELOCITY).trace() < 0.01
    assert solutions[-1].inertial.cov_of(GYRO_BIAS).trace() < 1e-3
