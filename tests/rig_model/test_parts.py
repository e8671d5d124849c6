"""Estimates of the rig errors by thirds of a run."""

import numpy as np
import pytest

from stream_sfm.rig_model.parts import Parts
from stream_sfm.rig_model.terms import DELAY, TERMS

AT = TERMS.index(DELAY)


def parts_of(frames: int, delay: float, drift: float, rng: np.random.Generator) -> Parts:
    """Parts of a run whose frames show a delay, in units of the assumed σ, which seems to drift over the run."""
    t = len(TERMS)
    size = np.full(t, 0.7)
    information, weighted, parts = np.diag(size**-2.0), np.zeros(t), Parts()
    for k in range(frames):
        direction = rng.normal(size=t)
        seen = direction[AT] * (delay + drift * (k / frames - 0.5)) + rng.normal(scale=0.1)
        information = information + np.outer(direction, direction) / 0.1**2
        weighted = weighted + direction * seen / 0.1**2
        parts = parts.after(information, weighted, size)
    return parts


@pytest.mark.parametrize(("frames", "least"), [(30, 0.0), (97, 0.6), (300, 0.6)])
def test_thirds_that_agree_give_the_error_and_its_sigma(frames: int, least: float) -> None:
    """For a short run, whose thirds do not determine each term separately, the sigma is too large."""
    rng = np.random.default_rng(frames)
    off = []
    for _ in range(60):
        found = parts_of(frames, 0.5, 0.0, rng).agreement
        assert found is not None
        off.append((found.mean[AT] - 0.5) / found.std[AT])
    # with two degrees of freedom for the spread, which is at least 1, σ is a little too large
    assert least < np.sqrt(np.mean(np.square(off))) < 1.2


def test_thirds_that_disagree_are_no_evidence() -> None:
    rng = np.random.default_rng(1)
    real, made_up = parts_of(200, 0.5, 0.0, rng).agreement, parts_of(200, 0.1, 3.0, rng).agreement
    assert real is not None and made_up is not None
    assert real.evidence[AT] > 20 and made_up.evidence[AT] < 2
    assert made_up.spread[AT] > 10


def test_a_part_that_reduces_information_contributes_nothing() -> None:
    """Rows may lose information about a delay: other parts keep theirs, and no part has negative information."""
    rng, t = np.random.default_rng(3), len(TERMS)
    parts = parts_of(200, 0.5, 0.0, rng)
    assert parts.latest is not None
    information, weighted = parts.latest.information + np.eye(t) / 0.7**2, parts.latest.weighted.copy()
    taken = 0.3 * parts.latest.information[AT, AT]
    for _ in range(100):
        information[AT, AT] -= taken / 100
        weighted[AT] -= 0.5 * taken / 100
        parts = parts.after(information, weighted, np.full(t, 0.7))
    found = parts.agreement
    assert found is not None and (found.std > 0).all() and np.isfinite(found.mean).all()
    assert found.spread[AT] < 3
    assert abs(found.mean[AT] - 0.5) < 5 * found.std[AT] < 0.25


def test_frames_that_do_not_count_are_in_no_part() -> None:
    """A body is followed for a while: its frames show another error, on which all of them agree."""
    rng, t = np.random.default_rng(4), len(TERMS)
    size = np.full(t, 0.7)
    information, weighted, parts, counting = np.diag(size**-2.0), np.zeros(t), Parts(), Parts()
    for k in range(200):
        counts = not 40 <= k < 140
        direction = rng.normal(size=t)
        seen = direction[AT] * (0.5 if counts else -3.0) + rng.normal(scale=0.1)
        information = information + np.outer(direction, direction) / 0.1**2
        weighted = weighted + direction * seen / 0.1**2
        parts = parts.after(information, weighted, size, counts)
        counting = counting.after(information, weighted, size)
    found, wrong = parts.agreement, counting.agreement
    assert found is not None and wrong is not None and parts.latest is not None and parts.latest.frames == 100
    assert abs(found.mean[AT] - 0.5) < 5 * found.std[AT] < 0.25
    assert abs(wrong.mean[AT] - 0.5) > 0.5


def test_a_short_run_has_no_thirds_and_a_long_one_keeps_few() -> None:
    rng = np.random.default_rng(2)
    assert parts_of(20, 0.5, 0.0, rng).agreement is None
    long = parts_of(1000, 0.5, 0.0, rng)
    assert len(long.ends) <= 12 and long.agreement is not None
