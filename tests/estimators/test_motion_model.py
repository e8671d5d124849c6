"""The motion model: the uncertainty of a predicted pose does not depend on maps that began and were lost."""

import numpy as np
import pytest

from stream_sfm.config import MotionConfig
from stream_sfm.estimators.motion_model import MotionModel, Unreliable
from stream_sfm.geometry import se3

FRAME_NS = 50_000_000
CONFIG = MotionConfig(std_acceleration_m_s2=2.0, std_angular_acceleration_rad_s2=1.0)
STILL = np.zeros((6, 6))


def model(velocity: bool) -> MotionModel:
    """A camera at rest, so that the motion does not rotate covariances."""
    motion = MotionModel(CONFIG)
    motion.restart(0, np.eye(4), STILL)
    if velocity:
        motion.add(FRAME_NS, np.eye(4), STILL)
    return motion


@pytest.mark.parametrize("velocity", [True, False])
def test_maps_that_begin_and_are_lost_change_nothing(velocity: bool) -> None:
    """A new map starts at the predicted pose and measures no velocity: uncertainty grows as if it had never begun."""
    unbroken, broken = model(velocity), model(velocity)
    for frame in range(2, 20):
        stamp_ns = frame * FRAME_NS
        expected = unbroken.predict(stamp_ns)[1]
        pose, cov = broken.predict(stamp_ns)
        np.testing.assert_allclose(cov, expected, rtol=1e-9)
        if frame % 3 == 0:
            broken.restart(stamp_ns, pose, cov)


def test_a_measured_velocity_restarts_the_growth_of_uncertainty() -> None:
    motion = model(velocity=True)
    motion.add(10 * FRAME_NS, np.eye(4), STILL)
    for frames in (1, 6):
        std = np.sqrt(np.diag(motion.predict((10 + frames) * FRAME_NS)[1]))
        half_square_s2 = 0.5 * (frames * FRAME_NS / 1e9) ** 2
        np.testing.assert_allclose(std, half_square_s2 * np.repeat([2.0, 1.0], 3))


def test_an_unreliable_start_is_covered_from_the_start_and_permanently_if_nothing_confirms_it() -> None:
    """A body is followed: the added covariance assumes no velocity, and stays if nothing confirms the start."""
    step, settles, none = se3.exp(np.array([0.05, 0, 0, 0, 0, 0.01])), {}, 1e-8 * np.eye(6)
    for name, of_start, unconfirmed in (("later", False, False), ("settled", True, False), ("open", True, True)):
        moving, pose = MotionModel(MotionConfig()), np.eye(4)
        moving.restart(0, pose, none)
        for k in range(1, 20):
            pose, wrong = pose @ step, 5 <= k < 15
            unreliable = Unreliable(wrong, of_start and wrong, unconfirmed and k == 15)
            cov = moving.add(k * 50_000_000, pose, none, unreliable)
            settles[name, k] = np.sqrt(np.linalg.eigvalsh(cov[:3, :3]).max())
    assert settles["later", 5] < 0.02  # the camera continues as in the previous frames
    assert settles["open", 5] > 5 * 0.05  # these poses may be relative to a body
    assert settles["settled", 16] < 1e-3
    assert settles["open", 16] >= 0.9 * settles["open", 14]


def test_after_an_uncertain_pose_its_velocity_is_uncertain() -> None:
    model, nothing = MotionModel(MotionConfig()), np.zeros((6, 6))
    for n in range(3):
        model.add(n * 10**8, np.eye(4), nothing)
    step = np.array([0.1, 0, 0, 0, 0, 0])
    model.add(3 * 10**8, se3.exp(step), nothing, Unreliable(misfit=True))
    for frames in (1, 2, 5):  # lost frames since then
        pose, cov = model.predict((3 + frames) * 10**8)
        np.testing.assert_allclose(pose[0, 3], 0.1 * (1 + frames))
        assert np.sqrt(cov[0, 0]) > pose[0, 3]
