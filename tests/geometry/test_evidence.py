"""Evidence over frames: how often it errs, how soon it tells, and that nothing lasts against it."""

import math

import numpy as np
import pytest

from stream_sfm.geometry.evidence import Evidence, log_ratio, ratio_of_share

BOUND, MEMORY = 6.0, 50.0


def begun_in(ratios: np.ndarray, evidence: Evidence) -> int | None:
    """The first frame (from 1) after which the state has changed; None if it has not."""
    there = evidence.is_there
    for k, nats in enumerate(ratios, 1):
        evidence = evidence.after(float(nats))
        if evidence.is_there != there:
            return k
    return None


def test_a_change_that_is_not_there_is_found_no_more_often_than_the_bound_says() -> None:
    """Per frame with probability e^−bound at most: here 124 in 50 000 frames, ± 11."""
    rng, amount = np.random.default_rng(0), 1.0
    ratios = amount * (rng.normal(size=50_000) - amount / 2)
    evidence, found = Evidence(BOUND, math.inf), 0
    for nats in ratios:
        evidence = evidence.after(float(nats))
        if evidence.is_there:
            evidence, found = Evidence(BOUND, math.inf), found + 1
    assert 0 < found < len(ratios) * math.exp(-BOUND) + 3 * 11


def test_what_begins_is_found_as_soon_as_the_frames_together_say_so() -> None:
    """After `BOUND` over the mean evidence of a frame, and some frames more as the sum overshoots the bound."""
    rng, amount = np.random.default_rng(1), 1.0
    needed = [begun_in(amount * (rng.normal(amount, 1, 400) - amount / 2), Evidence(BOUND, 1e9)) for _ in range(200)]
    assert None not in needed
    mean, expected = float(np.mean([n for n in needed if n])), BOUND / (amount**2 / 2)
    assert expected - 3 < mean < expected + 3  # σ of the mean is 0.4


@pytest.mark.parametrize("per_frame", [0.5, 2.0, 7.0])
def test_beginning_and_ending_need_the_same(per_frame: float) -> None:
    frames = begun_in(np.full(100, per_frame), Evidence(BOUND, MEMORY))
    assert frames is not None
    there = Evidence(BOUND, MEMORY, is_there=True)
    assert begun_in(np.full(100, -per_frame), there) == frames
    assert begun_in(np.full(100, per_frame), there) is None


def test_evidence_before_a_change_hides_no_change() -> None:
    """However long something has been there, or one frame has said so, its end takes no longer."""
    long = Evidence(BOUND, MEMORY)
    for nats in [1e6, *np.full(1000, 3.0)]:
        long = long.after(float(nats))
    assert long.is_there and long.log_odds == BOUND
    assert begun_in(np.full(20, -2.0), long) == begun_in(np.full(20, -2.0), Evidence(BOUND, MEMORY, is_there=True))


def test_without_evidence_nothing_begins_or_ends() -> None:
    assert begun_in(np.zeros(1000), Evidence(BOUND, MEMORY)) is None
    assert begun_in(np.zeros(1000), Evidence(BOUND, MEMORY, is_there=True)) is None


def test_a_small_bias_of_the_likelihoods_adds_up_to_no_change() -> None:
    """Only more than bound/memory per frame does, which the frames that are remembered show together."""
    most = BOUND / MEMORY
    assert begun_in(np.full(10_000, 0.99 * most), Evidence(BOUND, MEMORY)) is None
    assert begun_in(np.full(10_000, 1.2 * most), Evidence(BOUND, MEMORY)) is not None


def test_the_ratio_of_an_amount_is_that_of_two_gaussians() -> None:
    shown, variance, expected = 0.7, 0.3, 1.2
    log_densities = [-((shown - mean) ** 2) / (2 * variance) for mean in (expected, 0.0)]
    assert log_ratio(shown, variance, expected) == pytest.approx(log_densities[0] - log_densities[1])


@pytest.mark.parametrize("favour", [2.0, 13.0])
@pytest.mark.parametrize("agree", [0, 3, 9, 12])
def test_the_ratio_of_counts_is_that_of_an_unknown_share(agree: int, favour: float) -> None:
    rng, draws, n = np.random.default_rng(1), 400_000, 12
    expected = np.count_nonzero(rng.binomial(n, rng.beta(favour, 1, draws)) == agree)
    other = np.count_nonzero(rng.binomial(n, rng.random(draws)) == agree)
    nats = ratio_of_share(agree, n, favour)
    if expected < 100:
        assert nats < np.log(200 / other)
    else:
        assert nats == pytest.approx(np.log(expected / other), abs=4 * np.sqrt(1 / expected + 1 / other))


def test_few_points_of_a_frame_count_as_less_and_many_as_one() -> None:
    nats = [ratio_of_share(n, n, 13.0) for n in (0, 1, 6, 40, 10_000)]
    assert nats == sorted(nats) and nats[0] == 0 and nats[-1] == pytest.approx(math.log(13), rel=2e-3)
    assert ratio_of_share(5000, 10_000, 2.0) == pytest.approx(0, abs=1e-3)
