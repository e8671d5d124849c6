"""Errors that no view shows, against Monte Carlo: wrong lengths, and the camera's axes turned."""

import numpy as np
import pytest

from stream_sfm.camera.unseen_errors import UnseenErrors
from stream_sfm.geometry import se3

STD_SCALE, STD_AXES_RAD = 0.004, 0.001
N = 40_000


def _draws() -> tuple[np.ndarray, np.ndarray]:
    """Relative errors of lengths (N,), and turns of the axes (N, 4, 4)."""
    rng = np.random.default_rng(5)
    turns = np.zeros((N, 6))
    turns[:, 3:5] = STD_AXES_RAD * rng.normal(size=(N, 2))
    return STD_SCALE * rng.normal(size=N), se3.exp(turns)


def _agree(claimed: np.ndarray, errors: np.ndarray) -> None:
    """Sample covariances of N draws scatter by √(2/N) of the variances; four times that, as in any element."""
    std = np.sqrt(np.diag(claimed)) + 1e-12
    sampled = errors.T @ errors / N
    assert np.abs((sampled - claimed) / np.outer(std, std)).max() < 4 * np.sqrt(2 / N)


def test_points_err_with_lengths_and_axes() -> None:
    point = np.array([0.7, -0.4, 3.0])
    scales, turns = _draws()
    moved = (1 + scales)[:, None] * se3.transform(turns, point[None])[:, 0]
    axes = se3.exp(np.array([0, 0, 0, 0.3, -0.2, 0.5]))[:3, :3]
    unseen = UnseenErrors(STD_SCALE, STD_AXES_RAD)
    shared = np.random.default_rng(6).normal(size=(N, 1)) * [0.002, 0.001, -0.003]
    found = unseen.in_points(np.zeros((1, 3, 3)), point[None], np.array([[0.002, 0.001, -0.003]]), axes)
    _agree(found[0], (moved - point + shared) @ axes.T)


def test_poses_err_with_lengths_and_axes() -> None:
    """A pose in other axes is C T C⁻¹; its error is the perturbation on the right of T."""
    pose = se3.exp(np.array([0.5, -0.2, 2.0, 0.1, 0.6, -0.3]))
    scales, turns = _draws()
    seen = turns @ pose @ se3.inverse(turns)
    seen[:, :3, 3] *= (1 + scales)[:, None]
    errors = se3.log(se3.inverse(pose) @ seen)
    cov = UnseenErrors(STD_SCALE, STD_AXES_RAD).of_pose(pose)
    _agree(cov[:5, :5], errors[:, :5])
    assert cov[5, 5] == pytest.approx(errors[:, 5] @ errors[:, 5] / N, rel=4 * np.sqrt(2 / N))


def test_of_motions_that_follow_each_other_it_is_one_error() -> None:
    """A motion over two has the error of both: first and second are not independent, and lengths do not average."""
    first, second = se3.exp(np.array([[0.5, -0.2, 2.0, 0.1, 0.6, -0.3], [0.1, 0.4, 1.0, -0.2, 0.3, 0.1]]))
    unseen = UnseenErrors(STD_SCALE, STD_AXES_RAD)
    ad = se3.adjoint(se3.inverse(second))
    assert ad @ unseen.by_pose(first) + unseen.by_pose(second) == pytest.approx(
        unseen.by_pose(first @ second), abs=1e-15
    )


def test_without_errors_nothing_is_added() -> None:
    assert not UnseenErrors(0, 0).of_pose(np.stack([se3.exp(np.arange(6.0))] * 2)).any()
    nothing = UnseenErrors(0, 0).in_points(np.zeros((3, 3, 3)), np.ones((3, 3)), np.zeros((3, 3)), np.eye(3))
    assert not nothing.any()
