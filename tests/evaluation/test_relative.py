"""Relative errors: growth of known processes, and intervals of ratios that mean what they say.

docs/accuracy.md has the shares over 400 logs of each kind and of more kinds; 100 are enough to see an interval that is
wrong.
"""

import numpy as np
import pytest
from numpy.typing import NDArray

from stream_sfm.evaluation.relative import growth_exponents, paired_ratio, relative_errors, span_ratio, turning
from stream_sfm.geometry import se3

Array = NDArray[np.float64]
RNG = np.random.default_rng(5)
TRIALS = 100
SHARE = (0.0, 0.05 + 4 * np.sqrt(0.05 * 0.95 / TRIALS))  # 5 %, and four standard errors of so many logs
STD = np.repeat([1e-3, 3e-4], 3)  # m and rad per frame
STEP = se3.exp(np.array([0, 0, 0.05, 0, 0.01, 0]))


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
def test_equal_methods_differ_in_one_log_of_twenty(kind: str) -> None:
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


@pytest.mark.parametrize("span", [1, 5, 20])
def test_equal_methods_differ_over_one_span_in_one_log_of_twenty(span: int) -> None:
    rng = np.random.default_rng(span)
    truth = paths(np.zeros((1, 149, 6)))[0]
    found = []
    for a, b in zip(*(paths(STD * noise(rng, 150, 0.5)) for _ in range(2)), strict=True):
        ratio = span_ratio(relative_errors(a, truth, span)[0], relative_errors(b, truth, span)[0], span)
        assert ratio is not None and ratio.low < ratio.value < ratio.high
        found.append(not ratio.low <= 1 <= ratio.high)
    assert np.mean(found) < SHARE[1]


def test_over_a_span_that_fits_five_times_there_is_no_interval() -> None:
    """The ratio of errors one of which is three times the other is three, whatever their sizes."""
    errors = np.random.default_rng(1).normal(size=90)
    ratio = span_ratio(3 * errors, errors, 18)
    assert ratio is not None and ratio.value == pytest.approx(3) and np.isnan(ratio.low)
    assert span_ratio(errors, 0 * errors, 18) is None


def test_a_difference_that_is_there_is_found() -> None:
    """Errors that are 1.5 times as large, in logs of 300 frames, are found in position and rotation."""
    rng = np.random.default_rng(3)
    one, other = (paths(f * STD * rng.normal(size=(40, 299, 6))) for f in (1.5, 1.0))
    truth = paths(np.zeros((1, 299, 6)))[0]
    found = [paired_ratio(a, b, truth) for a, b in zip(one, other, strict=True)]
    assert np.mean([all(r.low > 1 for r in ratios) for ratios in found if ratios]) > 0.9  # of 400 logs: 98 %
    inside = [r.low <= 1.5 <= r.high for ratios in found if ratios for r in ratios]
    assert np.mean(inside) > 0.975 - 3 * np.sqrt(0.025 * 0.975 / len(inside))  # three standard errors


TRUTH = paths(np.zeros((1, 1499, 6)))[0]


@pytest.mark.parametrize(("process", "expected"), [("random walk", 1.0), ("constant bias", 2.0), ("noise", 0.0)])
def test_the_exponent_names_the_process(process: str, expected: float) -> None:
    error = RNG.normal(size=(1500, 3))
    if process == "random walk":
        error = np.cumsum(error, axis=0)
    elif process == "constant bias":
        error = np.arange(1500)[:, None] * [0, 0, 1.0]
    estimate = np.tile(np.eye(4), (1500, 1, 1))
    estimate[:, :3, 3] = 1e-3 * error
    estimate[:, :3, :3] = se3.exp_so3(np.cumsum(RNG.normal(size=(1500, 3)), axis=0) * 1e-7)
    found = growth_exponents(estimate, np.tile(np.eye(4), (1500, 1, 1)))
    assert found is not None
    # One sample path of 1500 frames; the interval of a constant bias has no width.
    assert found[0].value == pytest.approx(expected, abs=0.25)
    assert found[0].low <= found[0].value <= found[0].high
    assert found[1].value == pytest.approx(1.0, abs=0.25)  # the rotation walks at random


def test_too_short_or_exact_has_no_exponent_and_no_ratio() -> None:
    short = [TRUTH[:59] @ se3.exp(1e-3 * RNG.normal(size=(59, 6))) for _ in range(2)]
    assert growth_exponents(short[0], TRUTH[:59]) is None and growth_exponents(TRUTH, TRUTH) is None
    assert paired_ratio(short[0][:39], short[1][:39], TRUTH[:39]) is None


def test_paired_ratio_of_a_scaled_error_is_the_scale() -> None:
    walk = np.cumsum(RNG.normal(size=(1500, 6)), axis=0) * 1e-5
    found = paired_ratio(TRUTH @ se3.exp(3 * walk), TRUTH @ se3.exp(walk), TRUTH)
    assert found is not None
    for ratio in found:  # to what three times an error of 1e-4 rad is not three times the motion
        assert [ratio.low, ratio.value, ratio.high] == pytest.approx([3, 3, 3], rel=0.02)


def test_relative_errors_do_not_see_a_common_motion() -> None:
    for errors in relative_errors(se3.exp(RNG.normal(size=6)) @ TRUTH, TRUTH, 3):
        np.testing.assert_allclose(errors, 0, atol=1e-6)  # the root of rounding in a cosine


def test_turning_is_recognised_by_the_rate() -> None:
    stamps = np.arange(1500) * 100_000_000
    assert turning(stamps, TRUTH, 10).all()  # 0.01 rad in 0.1 s, 5.7° per second
    assert not turning(2 * stamps, TRUTH, 10).any()
