"""Samples never make it worse where the model holds: the window with them and without, on the same views."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import Config
from stream_sfm.config.inertia_rules import InertiaRules
from stream_sfm.estimators.cross_frame.inertia import Inertia
from stream_sfm.estimators.cross_frame.inertia_checks import Densities
from stream_sfm.estimators.cross_frame.interval import JOINT, Known
from stream_sfm.inertial.state import GRAVITY, SCALE, STATE
from stream_sfm.methods import REFERENCE, WITHOUT_IMU
from stream_sfm.types import Status
from tests.helpers.estimators import nees, run
from tests.helpers.imu_views import PROJECTION, observed
from tools.render.inertial import CONSUMER

FRAMES = 40


@pytest.mark.parametrize("seed", [21, 26, 33])
def test_positions_are_no_farther_off_with_samples_than_without(seed: int) -> None:
    poses, observations = zip(*observed(seed, FRAMES), strict=True)
    error = {}
    for method in (REFERENCE, WITHOUT_IMU):
        found = run(method, PROJECTION, observations)
        assert all(e.status is Status.OK for e in found[1:])
        apart = [e.world_from_cam[:3, 3] - p[:3, 3] for e, p in zip(found, poses, strict=True)]
        error[method] = np.sqrt(np.mean(np.square(apart)))
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
        apart = [e.world_from_cam[:3, 3] - p[:3, 3] for e, p in zip(found, poses, strict=True)]
        error.append(np.sqrt(np.mean(np.square(apart))))
    assert error[1] <= 1.3 * error[0]
    assert found[-1].inertial.densities == pytest.approx([10.0, 10.0], rel=0.5)


def test_noise_that_a_unit_hides_makes_its_data_sheet_no_better() -> None:
    rules = InertiaRules()
    assert Densities.begun(rules, np.array([0.1, 3.0])).factors == pytest.approx([1.0, 3.0, 1.0])
    assert Densities.begun(rules).factors == pytest.approx(np.ones(3))


def test_a_pose_moves_with_the_scale_only_as_far_as_the_rig_does_not_explain_both() -> None:
    z, scale = 2, JOINT.within("state", SCALE).start
    state = np.zeros(STATE)
    state[GRAVITY], state[SCALE] = [0.0, 9.81, 0.0], 1e-3
    given, by_rig = np.diag(np.full(JOINT.size, 1e-6)), np.zeros(JOINT.size)
    by_rig[[z, scale]] = -0.1, 1e-2
    moved = []
    for shared in (0.0, 5e-7):
        given[z, scale] = given[scale, z] = shared
        known = Known(0, np.eye(4), state, given.copy())
        found = Inertia(Config())._with_odds(known, given + np.outer(by_rig, by_rig))
        assert abs(found.state[SCALE][0]) < 0.2 * state[SCALE][0]  # exactly zero, by the odds
        moved.append(found.world_from_cam[:3, 3])
    assert moved[0] == pytest.approx(np.zeros(3), abs=1e-9)
    assert moved[1] == pytest.approx([0.0, 0.0, -5e-4], rel=0.2)
