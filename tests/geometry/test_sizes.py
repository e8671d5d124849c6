"""Sizes of errors: found by the likelihood of a frame, remembered while they last, and forgotten afterwards."""

import numpy as np
import pytest

from stream_sfm.geometry.sizes import SIZES, Sizes

STD = 0.1  # of a measured amplitude


def after(sizes: Sizes, amplitudes: np.ndarray) -> Sizes:
    """The sizes after a frame with these amplitudes (3,), as estimated with a prior of σ = 1."""
    information = np.eye(3) / STD**2
    cov = np.linalg.inv(information + np.eye(3))
    return sizes.after_amplitudes(cov @ information @ amplitudes, cov)


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
        sizes = sizes.after_amplitudes(np.zeros(3), np.eye(3))
    assert sizes.probabilities == pytest.approx(Sizes().probabilities, abs=0.01)
    assert sizes.after_amplitudes(np.zeros(0), np.zeros((0, 0))) is sizes
