"""Accelerations: those that a run has shown count while it is lost, whatever the frame rate and the noise of poses."""

import numpy as np
import pytest

from stream_sfm.config import MotionConfig
from stream_sfm.estimators.accelerations import Accelerations
from stream_sfm.estimators.motion_model import MotionModel, Unreliable
from stream_sfm.geometry import se3

ASSUMED = np.full(6, 3.0)


def poses(seconds: np.ndarray, size: float, std_m: float = 0.0) -> list[np.ndarray]:
    """Poses of a camera that shakes along x and about y at 2 Hz, with accelerations of RMS `size`, and their noise."""
    rng, omega = np.random.default_rng(0), 4 * np.pi
    wave = np.sqrt(2) * size / omega**2 * np.sin(omega * seconds)
    return [se3.exp(np.array([w, 0, 0, 0, w, 0]) + std_m * np.r_[rng.normal(size=3), 0, 0, 0]) for w in wave]


def shown(rate_hz: float, size: float, std_m: float = 0.0) -> np.ndarray:
    seconds, found = np.arange(0, 3, 1 / rate_hz), Accelerations.of(ASSUMED)
    for s, pose in zip(seconds, poses(seconds, size, std_m), strict=True):
        found = found.after(round(1e9 * s), pose)
    return found.std


@pytest.mark.parametrize("rate_hz", [20.0, 200.0])
def test_a_shaken_camera_is_expected_to_go_on_like_that(rate_hz: float) -> None:
    """One of three axes has them, so each counts as 1/√3 of them; a difference over 50 ms misses 2 % of them."""
    assert shown(rate_hz, 30.0)[[0, 3]] == pytest.approx(30 / np.sqrt(3), rel=0.15)


def test_the_assumed_ones_are_the_least_and_noise_of_poses_is_no_acceleration() -> None:
    assert shown(20.0, 1.0) == pytest.approx(ASSUMED)
    assert shown(200.0, 0.0, std_m=1e-4) == pytest.approx(ASSUMED)


def test_poses_that_may_be_wrong_and_new_maps_teach_nothing() -> None:
    model, stamps_ns = MotionModel(MotionConfig()), 50_000_000 * np.arange(20)
    model.restart(0, np.eye(4), np.zeros((6, 6)))
    for k, stamp_ns in enumerate(stamps_ns[1:].tolist()):
        model.add(stamp_ns, se3.exp(np.r_[k % 2, np.zeros(5)]), np.zeros((6, 6)), Unreliable(misfit=True))
    for k, stamp_ns in enumerate((stamps_ns[-1] + stamps_ns[1:]).tolist()):
        model.restart(stamp_ns, se3.exp(np.r_[k % 2, np.zeros(5)]), np.zeros((6, 6)))
    before = model.predict(stamp_ns)[1]
    grown = np.sqrt(np.diag(model.predict(stamp_ns + 100_000_000)[1] - before))
    assert grown.max() < 3.0 * 3.0  # metres: 3 m/s² since the first pose of two seconds ago
