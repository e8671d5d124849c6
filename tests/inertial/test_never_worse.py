"""Samples never make estimates worse if the model holds: the window with and without them, on the same views."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.estimators import make_estimator
from stream_sfm.estimators.window.inertia.checks import Densities, Jitter, with_odds
from stream_sfm.estimators.window.inertia.interval import JOINT, Known
from stream_sfm.estimators.window.inertia.rules import InertiaRules
from stream_sfm.geometry import se3
from stream_sfm.inertial.state import GRAVITY, SCALE, STATE
from stream_sfm.methods import REFERENCE, WITHOUT_IMU
from stream_sfm.types import Status
from tests.helpers.estimators import nees, run
from tests.helpers.imu_views import PROJECTION, observed, rms_m, swaying
from tools.render.inertial import CONSUMER

FRAMES = 40


@pytest.mark.parametrize("seed", [21, 26, 33])
def test_positions_are_no_farther_off_with_samples_than_without(seed: int) -> None:
    poses, observations = zip(*observed(seed, FRAMES), strict=True)
    error = {}
    for method in (REFERENCE, WITHOUT_IMU):
        found = run(method, PROJECTION, observations)
        assert all(e.status is Status.OK for e in found[1:])
        error[method] = rms_m(found, poses)
        after_start = zip(found[5:], poses[5:], strict=True)
        assert np.mean([nees(e.world_from_cam, e.cov_pose, p) for e, p in after_start]) < 12  # 6 expected
    assert error[REFERENCE] <= 1.05 * error[WITHOUT_IMU]


def test_a_data_sheet_that_is_ten_times_too_good_is_not_believed() -> None:
    of_unit = CONSUMER.calibration
    better = replace(of_unit, gyro_noise=of_unit.gyro_noise / 10, accel_noise=of_unit.accel_noise / 10)
    poses, observations = zip(*observed(27, FRAMES, CONSUMER), strict=True)
    believed = [replace(o, inertial=replace(o.inertial, calibration=better)) for o in observations]
    error = []
    for views in (observations, believed):
        found = run(REFERENCE, PROJECTION, views)
        assert all(e.status is Status.OK for e in found[1:])
        error.append(rms_m(found, poses))
    assert error[1] <= 1.3 * error[0]
    assert found[-1].inertial.densities == pytest.approx([10.0, 10.0], rel=0.5)


def test_noise_that_a_unit_hides_makes_its_data_sheet_no_better() -> None:
    rules = InertiaRules()
    assert Densities.begun(rules, np.array([0.1, 3.0])).factors == pytest.approx([1.0, 3.0, 1.0])
    assert Densities.begun(rules).factors == pytest.approx(np.ones(3))


@pytest.mark.parametrize("seed", [22, 36])
def test_stamps_that_err_are_no_contradiction(seed: int) -> None:
    std_s = 4e-3
    poses, observations = zip(*observed(seed, FRAMES, std_stamp_s=std_s), strict=True)
    error = {}
    for method in (REFERENCE, WITHOUT_IMU):
        estimator = make_estimator(method, PROJECTION, Config())
        found = [estimator.step(o) for o in observations]
        assert all(e.status is Status.OK for e in found[1:])
        error[method] = rms_m(found, poses)
        if method == REFERENCE:
            # noise of the images counts for as much as it may be
            assert 0.3 < np.sqrt(estimator.inertia._jitter.var_interval / 2) / std_s < 1.5
    assert error[REFERENCE] <= 1.05 * error[WITHOUT_IMU]


def test_stamps_that_do_not_err_are_known_not_to() -> None:
    rng, exact, err = np.random.default_rng(7), Jitter(InertiaRules()), Jitter(InertiaRules())
    images, stamps = rng.normal(0, 1e-3, 400), rng.normal(0, 2e-3, 400)
    for k in range(1, 400):  # images err alike: what one motion has too much the next one lacks
        by_images = images[k] - images[k - 1]
        exact = exact.after(by_images + 4e-3, 2 * 1e-3**2)  # and by the same in all frames, as with a wrong scale
        err = err.after(by_images + stamps[k] - stamps[k - 1], 2 * 1e-3**2)
    assert np.sqrt(exact.var_interval / 2) < 5e-4
    assert np.sqrt(err.var_interval / 2) == pytest.approx(2e-3, rel=0.25)


@pytest.mark.parametrize("seed", [24, 30])
def test_a_map_that_begins_on_a_body_is_not_a_map(seed: int) -> None:
    poses, observations = zip(*observed(seed, FRAMES, body_from=28), strict=True)
    found = run(REFERENCE, PROJECTION, observations)
    for estimate, pose in list(zip(found, poses, strict=True))[28:]:
        assert estimate.status is not Status.OK
        assert nees(estimate.world_from_cam, estimate.cov_pose, pose) < 36
    without = run(WITHOUT_IMU, PROJECTION, observations)
    assert without[-1].status is Status.OK  # nothing but samples can tell


@pytest.mark.parametrize("seed", [21, 26])
def test_the_first_frame_of_a_map_turns_as_the_gyroscope_says(seed: int) -> None:
    estimator, path, h = make_estimator(REFERENCE, PROJECTION, Config()), swaying(seed), 1e-4
    for _, views in observed(seed, 4):
        estimator.step(views)
    of_points = -se3.log(se3.inverse(path(-h)) @ path(h))[3:] / (2 * h)
    assert np.linalg.norm(of_points) > 0.1
    turning = estimator.map.reference.turning
    assert turning is not None
    assert turning[0] == pytest.approx(of_points, abs=0.01)


def test_a_pose_moves_with_the_scale_only_as_far_as_the_rig_does_not_explain_both() -> None:
    z, scale = 2, JOINT.within("state", SCALE).start
    state = np.zeros(STATE)
    state[GRAVITY], state[SCALE] = [0.0, 9.81, 0.0], 1e-3
    given, by_rig = np.diag(np.full(JOINT.size, 1e-6)), np.zeros(JOINT.size)
    by_rig[[z, scale]] = -0.1, 1e-2
    config, moved = Config(), []
    std_fixed = np.r_[config.rig.std_baseline, np.full(3, config.imu.std_axes_rad), config.imu.std_time_offset_s]
    for shared in (0.0, 5e-7):
        given[z, scale] = given[scale, z] = shared
        known = Known(0, np.eye(4), state, given.copy())
        found = with_odds(known, given + np.outer(by_rig, by_rig), std_fixed, config.rig)
        assert found.state[SCALE][0] == pytest.approx(0.0, abs=1e-15)  # exactly, by the odds
        moved.append(found.world_from_cam[:3, 3])
    assert moved[0] == pytest.approx(np.zeros(3), abs=1e-9)
    assert moved[1] == pytest.approx([0.0, 0.0, -5e-4], rel=0.2)
