"""The axes of the physical camera, and errors that no view shows (lengths, axes), against Monte Carlo."""

import numpy as np
import pytest

from stream_sfm.camera.unseen_errors import PhysicalAxes
from stream_sfm.geometry import se3

STD_SCALE, STD_AXES_RAD = 0.004, 0.001
N = 40_000
CAM_FROM_RECT = se3.exp(np.array([0, 0, 0, 0.3, -0.2, 0.5]))[:3, :3]
AXES = PhysicalAxes(CAM_FROM_RECT.T, STD_SCALE, STD_AXES_RAD)


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
    """And with their inverse depths in the camera that has seen them."""
    point, pose = np.array([0.7, -0.4, 3.0]), se3.exp(np.array([0.5, 0.1, -0.4, 0.1, -0.2, 0.3]))
    std_shared = 0.0015  # 1/m: errors of one or two centimetres
    scales, turns = _draws()
    moved = (1 + scales)[:, None] * se3.transform(turns, point[None])[:, 0]
    in_cam = se3.transform(se3.inverse(pose), point[None])[0]
    relative = std_shared * in_cam[2] * np.random.default_rng(6).normal(size=(N, 1))
    found, cov = AXES.points(point[None], np.zeros((1, 3, 3)), np.array([std_shared]), pose)
    assert found[0] == pytest.approx(CAM_FROM_RECT @ point)
    _agree(cov[0], (moved - point + relative * (pose[:3, :3] @ in_cam)) @ CAM_FROM_RECT.T)


def test_poses_err_with_lengths_and_axes() -> None:
    """A pose in other axes is C T C⁻¹; its error is the perturbation on the right of T."""
    pose = se3.exp(np.array([0.5, -0.2, 2.0, 0.1, 0.6, -0.3]))
    scales, turns = _draws()
    seen = turns @ pose @ se3.inverse(turns)
    seen[:, :3, 3] *= (1 + scales)[:, None]
    errors = se3.log(se3.inverse(pose) @ seen)
    cov = PhysicalAxes(np.eye(3), STD_SCALE, STD_AXES_RAD).motions(pose[None], np.zeros((1, 6, 6)))[1][0]
    _agree(cov[:5, :5], errors[:, :5])
    assert cov[5, 5] == pytest.approx(errors[:, 5] @ errors[:, 5] / N, rel=4 * np.sqrt(2 / N))


def test_motions_turn_with_the_axes() -> None:
    """C⁻¹ T Exp(ξ) C = (C⁻¹ T C) Exp(Cᵀξ), of each error that moves them."""
    turn, rng = se3.from_rotation_translation(CAM_FROM_RECT, np.zeros(3)), np.random.default_rng(7)
    motions, by_terms = se3.exp(rng.normal(size=(2, 6))), 1e-6 * rng.normal(size=(2, 6, 4))
    poses, cov, by_common = AXES.motions(motions, by_terms @ np.swapaxes(by_terms, 1, 2), by_terms)
    assert poses == pytest.approx(turn @ motions @ se3.inverse(turn), abs=1e-12)
    for i in range(4):
        moved = turn @ motions @ se3.exp(by_terms[..., i]) @ se3.inverse(turn)
        assert by_common[..., 3 + i] == pytest.approx(se3.log(se3.inverse(poses) @ moved), abs=1e-11)
    assert cov == pytest.approx(by_common @ np.swapaxes(by_common, 1, 2), abs=1e-15)


def test_of_motions_that_follow_each_other_it_is_one_error() -> None:
    """A motion over two has the error of both: first and second are not independent, and lengths do not average."""
    first, second = se3.exp(np.array([[0.5, -0.2, 2.0, 0.1, 0.6, -0.3], [0.1, 0.4, 1.0, -0.2, 0.3, 0.1]]))
    motions = np.stack([first, second, first @ second])
    by_first, by_second, by_both = PhysicalAxes(np.eye(3), STD_SCALE, STD_AXES_RAD).motions(
        motions, np.zeros((3, 6, 6))
    )[2]
    assert se3.adjoint(se3.inverse(second)) @ by_first + by_second == pytest.approx(by_both, abs=1e-15)


def test_without_errors_nothing_is_added() -> None:
    axes = PhysicalAxes(CAM_FROM_RECT.T)
    assert not axes.motions(np.stack([se3.exp(np.arange(6.0))] * 2), np.zeros((2, 6, 6)))[1].any()
    assert not axes.points(np.ones((3, 3)), np.zeros((3, 3, 3)), np.zeros(3), np.eye(4))[1].any()
