"""Intervals mean what they say: how often they exclude the truth, over many logs of methods that are known.

docs/accuracy.md has the shares over 400 logs of each kind and of more kinds; 100 are enough to see an interval that is
wrong.
"""

import numpy as np
import pytest
from numpy.typing import NDArray

from stream_sfm.evaluation.relative import paired_ratio
from stream_sfm.geometry import se3

TRIALS = 100
SHARE = (0.0, 0.05 + 4 * np.sqrt(0.05 * 0.95 / TRIALS))  # 5 %, and four standard errors of so many logs
STD = np.repeat([1e-3, 3e-4], 3)  # m and rad per frame
STEP = se3.exp(np.array([0, 0, 0.05, 0, 0.01, 0]))
Array = NDArray[np.float64]


def paths(noise: Array) -> Array:
    """Paths (trials, n + 1, 4, 4) whose motions per frame are off by `noise` (trials, n, 6)."""
    trials, frames, _ = noise.shape
    motions = STEP @ se3.exp(noise.reshape(-1, 6)).reshape(trials, frames, 4, 4)
    found = np.empty((trials, frames + 1, 4, 4))
    found[:, 0] = np.eye(4)
    for k in range(frames):
        found[:, k + 1] = found[:, k] @ motions[:, k]
    return found


def noise(rng: np.random.Generator, frames: int, lasting: float = 0.0) -> Array:
    """Standard errors (trials, frames − 1, 6) of motions, each correlated with the one before it by `lasting`."""
    found = rng.normal(size=(TRIALS, frames - 1, 6))
    for k in range(1, frames - 1):
        found[:, k] = lasting * found[:, k - 1] + np.sqrt(1 - lasting**2) * found[:, k]
    return found


@pytest.mark.parametrize("kind", ["few frames", "shared", "lasting", "uneven"])
def test_equal_methods_are_told_apart_in_one_log_of_twenty(kind: str) -> None:
    """Errors of one distribution: 90 % of their variance shared, autocorrelated over 2 frames, or growing."""
    rng = np.random.default_rng(len(kind))
    frames = 60 if kind == "few frames" else 150
    one, other = (noise(rng, frames, 0.5 if kind == "lasting" else 0.0) for _ in range(2))
    if kind == "shared":
        common = np.sqrt(0.9) * noise(rng, frames)
        one, other = (common + np.sqrt(0.1) * own for own in (one, other))
    elif kind == "uneven":
        one, other = (np.linspace(1, 4, frames - 1)[:, None] * own for own in (one, other))
    truth = paths(np.zeros((1, frames - 1, 6)))[0]
    ratios = [paired_ratio(a, b, truth) for a, b in zip(paths(STD * one), paths(STD * other), strict=True)]
    apart = np.mean([any(not r.low <= 1 <= r.high for r in pair) for pair in ratios if pair])
    assert SHARE[0] < apart < SHARE[1]


def test_a_difference_that_is_there_is_found() -> None:
    """Errors that are 1.5 times as large, in logs of 300 frames, are found in position and rotation."""
    rng = np.random.default_rng(3)
    one, other = (paths(f * STD * rng.normal(size=(40, 299, 6))) for f in (1.5, 1.0))
    truth = paths(np.zeros((1, 299, 6)))[0]
    found = [paired_ratio(a, b, truth) for a, b in zip(one, other, strict=True)]
    assert np.mean([all(r.low > 1 for r in ratios) for ratios in found if ratios]) > 0.9  # of 400 logs: 98 %
    inside = [r.low <= 1.5 <= r.high for ratios in found if ratios for r in ratios]
    assert np.mean(inside) > 0.975 - 3 * np.sqrt(0.025 * 0.975 / len(inside))  # three standard errors
