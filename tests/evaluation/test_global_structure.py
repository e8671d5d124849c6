"""Test points in the world: exact where pose and point are, off by the drift of the pose, and as far as σ says."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stream_sfm.evaluation.global_structure import TestPoints
from stream_sfm.geometry import se3
from stream_sfm.types import Trajectory

FRAMES, POINTS, STD = 30, 400, 0.02
STAMPS_NS = np.arange(FRAMES) * 100_000_000
TRUE = np.stack([se3.exp([0.1 * n, 0.0, 0.02 * n, 0.0, 0.01 * n, 0.0]) for n in range(FRAMES)])
WORLD = np.random.default_rng(0).uniform((-3, -2, 4), (6, 2, 9), (POINTS, 3))
IDS = np.arange(POINTS)


def seen(n: int, estimated: np.ndarray, noise_m: np.ndarray) -> Any:
    """The estimate of a frame, which reports all points: at their true places in the camera, but for noise."""
    in_world = se3.transform(estimated[n] @ se3.inverse(TRUE[n]), WORLD) + noise_m
    cov = np.broadcast_to(STD**2 * np.eye(3), (POINTS, 3, 3))
    return SimpleNamespace(track_ids=IDS, stamp_ns=int(STAMPS_NS[n]), points_in_world=in_world, cov_points_in_world=cov)


def compared(estimated: np.ndarray, noise: float = 0.0, truth: slice = slice(None)) -> dict[str, Any]:
    """The figures of a run in which even points have a depth in even frames."""
    rng, points = np.random.default_rng(1), TestPoints()
    for n in range(FRAMES):
        rows = IDS[::2] if n % 2 == 0 else IDS[:0]
        true_in_cam = se3.transform(se3.inverse(TRUE[n]), WORLD[rows])
        points.add(seen(n, estimated, noise * STD * rng.normal(size=(POINTS, 3))), rows, true_in_cam)
    world = se3.exp([5.0, 1.0, 0.0, 0.0, 0.0, 0.3])  # of the ground truth: first poses are aligned
    return points.figures(Trajectory(STAMPS_NS, estimated), Trajectory(STAMPS_NS[truth], (world @ TRUE)[truth]))


def test_exact_estimates_have_no_error_in_any_world() -> None:
    moved = se3.exp([0.0, 2.0, 0.0, 0.1, 0.0, 0.0]) @ TRUE  # as in a map of an earlier run
    for estimated in (TRUE, moved):
        assert compared(estimated)["global_structure_rms_m"] < 1e-9


def test_drift_of_the_pose_is_an_error_of_the_points_in_view() -> None:
    drifted = np.stack([se3.exp([0.003 * n, 0, 0, 0, 0, 0]) @ pose for n, pose in enumerate(TRUE)])
    found = compared(drifted)
    assert found["global_structure_rms_m"] == pytest.approx(np.sqrt(np.mean((0.003 * np.arange(FRAMES)) ** 2)))
    assert found["global_structure_median_m"] == pytest.approx(0.003 * np.median(np.arange(FRAMES)))


@pytest.mark.parametrize("noise", [1.0, 2.0])
def test_errors_are_compared_with_their_covariances(noise: float) -> None:
    values = 3 * FRAMES * POINTS / 10  # every tenth point is one
    found = compared(TRUE, noise)
    assert found["global_structure_error_over_sigma"] == pytest.approx(noise, rel=4 / np.sqrt(2 * values))
    assert found["global_structure_rms_m"] == pytest.approx(noise * STD * np.sqrt(3), rel=4 / np.sqrt(2 * values))


def test_nothing_is_compared_without_a_true_first_pose() -> None:
    assert np.isnan(compared(TRUE, truth=slice(3, None))["global_structure_rms_m"])
    assert compared(TRUE, truth=slice(0, 20))["global_structure_rms_m"] < 1e-9
    assert np.isnan(TestPoints().figures(Trajectory(STAMPS_NS, TRUE), Trajectory(STAMPS_NS, TRUE))[
        "global_structure_rms_m"
    ])  # fmt: skip
