"""Own and common factors of σ are recovered from motions with common errors, each without regard to the other."""

import numpy as np
import pytest

from stream_sfm.evaluation.own_and_common import common_apart, own_and_common
from stream_sfm.geometry import se3
from stream_sfm.motion import Motion

MOTIONS, TERMS, TRIALS = 60, 4, 60
STD = np.repeat([1e-3, 2e-4], 3)


def drawn(rng: np.random.Generator, own: float, common: float) -> tuple[list[Motion], np.ndarray]:
    """Motions whose errors are `own` and `common` times too large, each as its frame knew c, and the truth."""
    root = rng.normal(size=(TERMS, TERMS)) / 2
    cov_c = root @ root.T
    c, motions, true = common * root @ rng.normal(size=TERMS), [], []
    for n in range(MOTIONS):
        moved = se3.exp([0.1, 0.0, 0.02, 0.0, 0.01 * np.sin(n), 0.0])
        by_c = rng.normal(size=(6, TERMS)) * STD[:, None]
        mean = 0.1 * rng.normal(size=TERMS) * (n < MOTIONS - 1)  # the last one knows that it is N(0, cov_c)
        motions.append(Motion(moved, np.diag(STD**2), by_c, mean, cov_c, n, n + 1))
        true.append(moved @ se3.exp(by_c @ (c - mean) + own * STD * rng.normal(size=6)))
    return motions, np.stack(true)


@pytest.mark.parametrize(("own", "common"), [(1.0, 1.0), (0.7, 1.0), (1.0, 2.5), (2.0, 1.0)])
def test_each_factor_is_the_excess_of_its_part(own: float, common: float) -> None:
    """The mean over runs: of own errors there are 360 in each, of common ones as many as are shown."""
    rng = np.random.default_rng(5)
    found = [own_and_common(*drawn(rng, own, common), np.zeros((6, 6)), 1.0) for _ in range(TRIALS)]
    squares = np.array([(f.own**2, f.common**2) for f in found if f.own and f.common])
    assert len(squares) == TRIALS
    shown = np.mean([f.shown for f in found])
    assert shown > 0.7 * TERMS
    assert np.sqrt(squares[:, 0].mean()) == pytest.approx(own, rel=4 / np.sqrt(2 * 6 * MOTIONS * TRIALS))
    assert np.sqrt(squares[:, 1].mean()) == pytest.approx(common, rel=4 / np.sqrt(2 * shown * TRIALS))


def test_motions_that_overlap_tell_less() -> None:
    """Motions that share frames three by three tell of c as one of them does, and too few tell nothing."""
    rng = np.random.default_rng(6)
    motions, true = drawn(rng, 1.0, 1.0)
    thrice = [m for m in motions for _ in range(3)], np.repeat(true, 3, axis=0)
    once, overlapping = (own_and_common(*x, np.zeros((6, 6)), n) for x, n in (((motions, true), 1.0), (thrice, 3.0)))
    assert overlapping == pytest.approx(once)
    assert own_and_common(motions[:2], true[:2], np.zeros((6, 6)), 8.0).own is None


def test_without_common_errors_all_is_own() -> None:
    rng = np.random.default_rng(7)
    moved = se3.exp([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    true = moved @ se3.exp(1.5 * STD * rng.normal(size=(400, 6)))
    found = own_and_common([Motion(moved, np.diag(STD**2))] * 400, true, np.zeros((6, 6)), 1.0)
    assert found.own == pytest.approx(1.5, rel=4 / np.sqrt(2 * 6 * 400))
    assert found.common is None


@pytest.mark.parametrize("too_small", [1.0, 2.0])
def test_halves_find_the_same_rig_within_its_covariance(too_small: float) -> None:
    """Two halves see the same c ~ N(0, I) with different noise; what both do not see, they agree about."""
    rng, trials, squares = np.random.default_rng(8), 300, []
    for _ in range(trials):
        c, halves = rng.normal(size=TERMS), []
        for _ in range(2):
            rows = rng.normal(size=(5, TERMS)) * [1.0, 1.0, 1.0, 1e-4]
            seen = rows @ c + too_small * rng.normal(size=5)
            cov = np.linalg.inv(np.eye(TERMS) + rows.T @ rows)
            halves.append(Motion(np.eye(4), np.eye(6), np.zeros((6, TERMS)), cov @ rows.T @ seen, cov))
        apart = common_apart(*halves)
        assert apart is not None
        squares.append(apart**2)
    assert np.sqrt(np.mean(squares)) == pytest.approx(too_small, rel=4 / np.sqrt(2 * 3 * trials))
    nothing = Motion(np.eye(4), np.eye(6))
    assert common_apart(nothing, nothing) is None
