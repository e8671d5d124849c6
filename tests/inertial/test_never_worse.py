"""Samples never make it worse where the model holds: the window with them and without, on the same views."""

import numpy as np
import pytest

from stream_sfm.methods import REFERENCE, WITHOUT_IMU
from stream_sfm.types import Status
from tests.helpers.estimators import nees, run
from tests.helpers.imu_views import PROJECTION, observed

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
