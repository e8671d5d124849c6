"""Sizes of errors: found by the likelihood of a frame, remembered while they last, and forgotten afterwards."""

import numpy as np
import pytest

from stream_sfm import core
from stream_sfm.geometry.sizes import SIZES, Sizes, Weighed, weigh

STD = 0.1  # of a measured amplitude


def estimate(amplitudes: np.ndarray, information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The estimate of amplitudes (n,) that are measured with this information (n, n), with a prior of σ = 1."""
    cov = np.linalg.inv(information + np.eye(len(amplitudes)))
    return cov @ information @ amplitudes, cov


def after(sizes: Sizes, amplitudes: np.ndarray) -> Sizes:
    """The sizes after a frame with these amplitudes (n,), each measured by itself, and one that it does not show."""
    n = len(amplitudes)
    shown = weigh(*estimate(np.append(amplitudes, 0.0), np.diag([STD**-2.0] * n + [0.0])), [n])
    return shown.sizes([sizes], shown.log)[0]


def test_the_evidence_of_amplitudes_is_that_of_their_densities() -> None:
    amplitudes = np.array([2.0, -5.0, 1.0])
    covs = [size**2 + STD**2 for size in SIZES]
    log = [-0.5 * float(amplitudes @ amplitudes) / cov - 1.5 * np.log(cov) for cov in covs]
    expected = Sizes().after(np.array(log)).probabilities
    assert after(Sizes(), amplitudes).probabilities == pytest.approx(expected, rel=1e-6)


def test_each_size_is_found_in_one_frame_and_most_frames_have_the_usual_one() -> None:
    rng = np.random.default_rng(0)
    for size in SIZES:
        found = [after(Sizes(), size * rng.normal(size=3)).probable for _ in range(200)]
        assert np.mean(np.array(found) == size) > 0.7
        assert np.mean(np.array(found) > size) < (0.05 if size == 1 else 0.2)


def test_a_size_that_lasts_is_expected_in_the_next_frame_and_fades() -> None:
    rng, sizes = np.random.default_rng(1), Sizes()
    for _ in range(10):
        sizes = after(sizes, 4 * rng.normal(size=3))
    assert sizes.probable == 4
    assert np.exp(sizes.log_prior)[1] > 0.5 > 5 * np.exp(Sizes().log_prior)[1]
    for _ in range(3):
        sizes = after(sizes, 0.5 * rng.normal(size=3))
    assert sizes.probable == 1


def test_a_frame_that_shows_nothing_only_forgets() -> None:
    sizes = after(Sizes(), np.full(3, 20.0))
    for _ in range(100):
        sizes = after(sizes, np.zeros(0))
    assert sizes.probabilities == pytest.approx(Sizes().probabilities, abs=0.01)


def test_blocks_that_look_alike_are_weighed_by_their_joint_density() -> None:
    """With the sizes of a block of three and one of two, and the amplitude left over, written out densely."""
    rng = np.random.default_rng(2)
    by_view = rng.normal(size=(40, 6))
    by_view[:, 3] = by_view[:, 0] + 0.1 * rng.normal(size=40)  # two blocks in which much looks alike
    z = rng.normal(size=40) + by_view @ np.array([6.0, 0.5, 0.3, 0.2, 0.1, 0.4])
    cov = np.linalg.inv(by_view.T @ by_view + np.eye(6))
    shown = weigh(cov @ by_view.T @ z, cov, [3, 2])
    assert len(shown.log) == len(SIZES) ** 2
    apart = []
    for rows, log, information, weighted in zip(*shown, strict=True):
        root = by_view[:, :5] * np.repeat(SIZES[rows], [3, 2])
        of_views = root @ root.T + np.eye(40)
        inverse = np.linalg.inv(of_views)
        apart.append(log + 0.5 * z @ inverse @ z + 0.5 * np.linalg.slogdet(of_views)[1])
        assert information == pytest.approx(by_view[:, 5] @ inverse @ by_view[:, 5], rel=1e-6)
        assert weighted == pytest.approx(by_view[:, 5] @ inverse @ z, rel=1e-6)
    assert apart == pytest.approx(np.full(16, apart[0]), abs=1e-6)


def test_the_sizes_of_two_blocks_are_the_marginals_of_their_combinations() -> None:
    before, log = [Sizes(), after(Sizes(), np.full(3, 20.0))], np.random.default_rng(3).normal(size=16)
    rows = np.indices((4, 4)).reshape(2, -1).T
    shown = Weighed(rows, log, np.ones(16), np.zeros(16))
    joint = np.exp(log.reshape(4, 4) + before[0].log_prior[:, None] + before[1].log_prior)
    sizes = shown.sizes(before, log)
    assert sizes[0].probabilities == pytest.approx(joint.sum(axis=1) / joint.sum())
    assert sizes[1].probabilities == pytest.approx(joint.sum(axis=0) / joint.sum())
    assert shown.total(before, log) == pytest.approx(np.log(joint.sum()))
    row = shown.rows[shown.row_of(sizes)]
    assert list(row) == [s.probabilities.argmax() for s in sizes]


def test_evidence_and_means_by_size_are_those_of_the_covariances() -> None:
    rng = np.random.default_rng(4)
    by_view, sizes = rng.normal(size=(9, 4)), np.array([[1.0, 1.0, 4.0, 0.0], [0.0, 2.0, 64.0, 1.0]])
    information, weighted = by_view.T @ by_view, by_view.T @ rng.normal(size=(9, 2))
    log_det, means = core.solved_by_size(information, weighted, sizes)
    for size, found, mean in zip(sizes, log_det, means, strict=True):
        cov = np.diag(size**2)
        assert found == pytest.approx(np.linalg.slogdet(np.eye(4) + information @ cov)[1], rel=1e-12)
        assert mean == pytest.approx(np.linalg.solve(np.eye(4) + cov @ information, cov @ weighted), rel=1e-9)
