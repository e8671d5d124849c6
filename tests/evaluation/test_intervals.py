"""Intervals mean what they say: how often they exclude the truth, over many logs of methods that are known."""

import numpy as np
import pytest

from stream_sfm.evaluation.relative import growth_exponents, paired_ratio
from stream_sfm.geometry import se3

TRIALS = 400
STANDARD_ERROR = np.sqrt(0.05 * 0.95 / TRIALS)  # binomial, of a share of 5 %
STD = np.repeat([1e-3, 3e-4], 3)  # m and rad per frame
STEP = se3.exp(np.array([0, 0, 0.05, 0, 0.01, 0]))


def paths(noise: np.ndarray) -> np.ndarray:
    """Paths (trials, n + 1, 4, 4) whose motions per frame are off by `noise` (trials, n, 6)."""
    trials, frames, _ = noise.shape
    motions = STEP @ se3.exp(noise.reshape(-1, 6)).reshape(trials, frames, 4, 4)
    found = np.empty((trials, frames + 1, 4, 4))
    found[:, 0] = np.eye(4)
    for k in range(frames):
        found[:, k + 1] = found[:, k] @ motions[:, k]
    return found


@pytest.mark.parametrize("shared", [0.0, 0.9])
@pytest.mark.parametrize("frames", [150, 300, 1000])
def test_equal_methods_are_told_apart_in_one_log_of_twenty(frames: int, shared: float) -> None:
    """Two methods whose errors have one distribution, and whose variance is shared between them in part."""
    rng = np.random.default_rng([frames, round(10 * shared)])
    size = (TRIALS, frames - 1, 6)
    common = np.sqrt(shared) * rng.normal(size=size)
    one, other = (paths(STD * (common + np.sqrt(1 - shared) * rng.normal(size=size))) for _ in range(2))
    truth = paths(np.zeros((1, frames - 1, 6)))[0]
    alarms = 0
    for a, b in zip(one, other, strict=True):
        ratios = paired_ratio(a, b, truth)
        assert ratios is not None
        alarms += any(not r.low <= 1 <= r.high for r in ratios)
    assert 0.03 - STANDARD_ERROR <= alarms / TRIALS <= 0.08 + STANDARD_ERROR, alarms


def test_a_difference_that_is_there_is_found() -> None:
    """Errors that are 1.5 times as large, in logs of 300 frames, are found in position and rotation."""
    rng = np.random.default_rng(3)
    one, other = (paths(f * STD * rng.normal(size=(40, 299, 6))) for f in (1.5, 1.0))
    truth = paths(np.zeros((1, 299, 6)))[0]
    found = [paired_ratio(a, b, truth) for a, b in zip(one, other, strict=True)]
    assert np.mean([all(r.low > 1 for r in ratios) for ratios in found if ratios]) > 0.9
    inside = [r.low <= 1.5 <= r.high for ratios in found if ratios for r in ratios]
    assert np.mean(inside) > 0.975 - 3 * np.sqrt(0.025 * 0.975 / len(inside))


def test_the_growth_of_a_random_walk_is_in_its_interval() -> None:
    rng = np.random.default_rng(4)
    truth = paths(np.zeros((1, 299, 6)))[0]
    walks = paths(STD * rng.normal(size=(TRIALS, 299, 6)))
    missed = 0
    for walk in walks:
        exponents = growth_exponents(walk, truth)
        assert exponents is not None
        missed += not exponents[1].low <= 1 <= exponents[1].high  # rotation: position also grows by the rotation
    assert 0.03 - STANDARD_ERROR <= missed / TRIALS <= 0.08 + STANDARD_ERROR, missed
