"""The size of a calibration's errors, as it is learnt from estimates of them."""

import numpy as np
import pytest

from stream_sfm.estimators.cross_frame.rig_knowledge import RigKnowledge
from stream_sfm.types import RigEstimate

M, DISPARITY, TRIALS = 13, 7, 400
OF_DISPARITY = np.arange(M) < DISPARITY


def estimate(rng: np.random.Generator, errors: np.ndarray, size: float, std: float = 0.05) -> RigEstimate:
    """What views with noise `std` say about errors (m,), with a prior of some size."""
    views = rng.normal(size=(2 * len(errors), len(errors)))
    information = views.T @ views / std**2
    seen = views.T @ (views @ errors + std * rng.normal(size=len(views))) / std**2
    cov = np.linalg.inv(information + np.eye(len(errors)) / size**2)
    return RigEstimate(cov @ seen, cov, True)


def test_the_size_does_not_depend_on_the_prior_that_the_estimate_was_made_with() -> None:
    errors = np.random.default_rng(1).normal(size=M)
    knowledge = RigKnowledge.unknown(M, OF_DISPARITY)
    sizes = []
    for size in (0.1, 1.0, 3.0):
        e = estimate(np.random.default_rng(2), errors, size)
        sizes.append(knowledge.resized(size)[0].likely_size(e))
    assert sizes == pytest.approx([sizes[0]] * 3, rel=1e-6)


@pytest.mark.parametrize("true", [0.0, 0.3, 1.0, 3.0])
def test_errors_that_were_not_seen_are_as_large_as_the_learnt_size_says(true: float) -> None:
    """Some errors are known; of the others nothing is known but that size: their NEES is right, or small by caution."""
    rng = np.random.default_rng(3)
    nees = []
    for _ in range(TRIALS):
        errors = true * rng.normal(size=M)
        of_disparity = estimate(rng, errors[:DISPARITY], 1.0)
        size = RigKnowledge.unknown(DISPARITY, OF_DISPARITY[:DISPARITY]).likely_size(of_disparity)
        nees.append((errors[DISPARITY:] ** 2).mean() / size**2)
    assert np.mean(nees) < (1.3 if true < 3 else 1.7)  # three is the largest size that is considered
    assert np.mean(nees) > 0.4 or true == 0


def test_without_views_errors_are_as_large_as_assumed_and_one_may_be_when_all_others_are_zero() -> None:
    knowledge = RigKnowledge.unknown(M, OF_DISPARITY)
    nothing = RigEstimate(np.zeros(M), (1 - 1e-9) * np.eye(M), False)
    assert knowledge.likely_size(nothing) == pytest.approx(1, rel=0.05)
    zero = RigEstimate(np.zeros(M), 1e-8 * np.eye(M), False)
    assert knowledge.likely_size(zero) == pytest.approx(0.1, rel=0.05)


def test_errors_of_the_lenses_do_not_tell_the_size() -> None:
    """What turning and growing patches do wrong looks like them, and must not make room for more of it."""
    mean, cov = np.zeros(M), 1e-6 * np.eye(M)
    mean[DISPARITY:] = 3.0
    assert RigKnowledge.unknown(M, OF_DISPARITY).likely_size(RigEstimate(mean, cov, True)) < 0.15
