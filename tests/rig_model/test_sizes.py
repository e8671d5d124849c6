"""Sizes and probabilities of a rig's errors, against the views themselves: likelihoods written out densely."""

from itertools import product

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from stream_sfm.config import RigConfig
from stream_sfm.geometry.se3 import Array
from stream_sfm.rig_model.sizes import likely_sizes, mixture
from stream_sfm.rig_model.terms import CAUSES, FOCAL, TERMS

T = len(TERMS)
M = T + 3  # with some amplitudes of a field
AT_FOCAL = TERMS.index(FOCAL)
SIZE = np.array([*np.linspace(0.4, 1.6, T), 0.3, 0.3, 0.3])


class Views:
    """Views z = A c + noise of errors c, and the estimate of c with a prior of sizes `SIZE`."""

    def __init__(self, seed: int, errors: Array, std: float) -> None:
        rng = np.random.default_rng(seed)
        self.a = rng.normal(size=(2 * M, M))
        self.noise = std**2 * np.eye(2 * M)
        self.z = self.a @ errors + std * rng.normal(size=2 * M)
        self.mean, self.cov = self.posterior(SIZE)

    def posterior(self, size: Array) -> tuple[Array, Array]:
        """Mean and covariance of errors with these sizes; size 0 means none."""
        gain = size[:, None] ** 2 * self.a.T @ np.linalg.inv(self.evidence_cov(size))
        return gain @ self.z, np.diag(size**2) - gain @ self.a * size**2

    def evidence_cov(self, size: Array) -> Array:
        return self.a * size**2 @ self.a.T + self.noise

    def log_evidence(self, size: Array) -> float:
        """log p(views) with errors of these sizes."""
        return float(multivariate_normal.logpdf(self.z, np.zeros(len(self.z)), self.evidence_cov(size)))


MAY_BE_ZERO = tuple(group.terms for group in CAUSES)
ODDS = RigConfig().odds  # of each, that it is not


def considered(views: "Views", size: Array, trusted: bool, refocused: bool) -> tuple[Array, Array]:
    """Errors of these sizes; each combination of the terms that may be 0 has its own likelihood. They count in full."""
    mean, cov = views.posterior(size)
    weights, sizes = combinations(views, size, trusted, refocused)
    held = np.average([views.posterior(without)[0] for without in sizes], axis=0, weights=weights)
    return held, cov + np.outer(mean - held, mean - held)


def combinations(views: "Views", size: Array, trusted: bool, refocused: bool) -> tuple[list[float], list[Array]]:
    """The probability of each combination of terms that may be 0, as before if not `trusted`; sizes of all errors then.

    The focal length is not 0 if it has `refocused`.
    """
    weights, sizes = [], []
    for zero in product((False, True), repeat=len(MAY_BE_ZERO)):
        at = [TERMS.index(name) for names, none in zip(MAY_BE_ZERO, zero, strict=True) if none for name in names]
        without, free = size.copy(), size.copy()
        without[at], free[at] = 0.0, 1.0
        prior = 0.0 if refocused and zero[0] else ODDS ** zero.count(False)
        evidence = views.log_evidence(without) - views.log_evidence(free)
        weights.append(prior * np.exp(evidence if trusted else 0.0))
        sizes.append(without)
    return weights, sizes


def lens_odds(views: "Views", others: Array) -> float:
    """The log odds that lenses have errors rather than none, with the other terms of these sizes."""
    of_lens, none = np.eye(M)[:AT_FOCAL], views.log_evidence(others)
    together = views.log_evidence(others + of_lens.sum(axis=0)) - none
    alone = [views.log_evidence(others + one) - none for one in of_lens]
    return float(np.logaddexp(np.log(0.95) + together, np.log(0.05) + logsumexp(alone, b=1 / AT_FOCAL)))


def with_size(k: int, size: float) -> Array:
    changed = SIZE.copy()
    changed[k] = size
    return changed


@pytest.mark.parametrize("errors", [0.0, 1.0])
def test_a_likely_size_is_an_average_by_the_likelihood_of_each(errors: float) -> None:
    """For one term at a time, with sizes from a fortieth to three, all equally probable on a logarithmic scale."""
    views = Views(3, errors * np.random.default_rng(4).normal(size=M), 0.5)
    found = likely_sizes(views.mean, views.cov, SIZE)
    half_step = 120 ** (1 / 80)  # each of 41 sizes represents those around it, including the first and last ones
    ends = np.geomspace(0.025 / half_step, 3.0 * half_step, 101)
    sizes = np.sqrt(ends[1:] * ends[:-1])
    for k in set(range(T)) - {AT_FOCAL}:
        weight = np.exp([views.log_evidence(with_size(k, s)) for s in sizes])
        expected = np.sqrt((weight * sizes**2).sum() / weight.sum())
        assert found[k] == pytest.approx(expected, rel=0.01)  # the step is 0.12
    assert found[AT_FOCAL] == SIZE[AT_FOCAL] and (found[T:] == SIZE[T:]).all()


def test_a_likely_size_does_not_depend_on_the_size_so_far() -> None:
    views = Views(5, SIZE, 0.5)
    small, large = (likely_sizes(*views.posterior(size), size)[0] for size in (with_size(0, 0.1), with_size(0, 3.0)))
    assert small == pytest.approx(large, rel=1e-6)


@pytest.mark.parametrize(("std", "errors"), [(0.5, 0.02), (2.0, 0.3), (4.0, 0.5), (8.0, 1.0)])
def test_a_share_of_the_information_of_views_counts_for_the_odds(std: float, errors: float) -> None:
    """A quarter counts as if noise had twice the σ; so views with too small a σ do not make the lenses seem wrong."""
    true = errors * SIZE * np.random.default_rng(6).normal(size=M)
    views = Views(1, true, std)
    rules = {share: RigConfig(counts=share, counts_of_lenses=share) for share in (0.25, 1.0)}
    quarter, all_of_it = (mixture(views.mean, views.cov, SIZE, rules[share]).p_wrong for share in rules)
    views.noise = 4 * views.noise
    doubled = mixture(*views.posterior(SIZE), SIZE, rules[1.0]).p_wrong
    assert quarter == pytest.approx(doubled, rel=0.02)
    assert abs(all_of_it - doubled) > 0.04 * doubled


@pytest.mark.parametrize("refocused", [True, False])
@pytest.mark.parametrize("trusted", [True, False])
@pytest.mark.parametrize(("std", "errors"), [(0.5, 1.0), (8.0, 0.0), (30.0, 1.0), (0.5, 0.0)])
def test_a_mixture_has_the_moments_of_its_two_halves(std: float, errors: float, trusted: bool, refocused: bool) -> None:
    """Lenses that are wrong with the probability from their likelihood; all other errors are in both halves.

    Wrong lenses have errors in all terms, or, one in twenty, in a single one; this is judged over all combinations of
    the other terms. If parts of a run disagree entirely, views do not show which of these are present; a focal length
    that has changed is.
    """
    rules = RigConfig(counts=1.0, counts_of_lenses=1.0)  # views whose σ is right
    true = errors * SIZE * np.random.default_rng(6).normal(size=M)
    views = Views(7, true, std)
    spread = 1.0 if trusted else 1e6
    found = mixture(views.mean, views.cov, SIZE, rules, spread=spread, refocused=refocused)
    k = np.arange(M)
    weights, sizes = combinations(views, np.where(k >= AT_FOCAL, SIZE, 0.0), trusted, refocused)
    odds = [lens_odds(views, size) for size in sizes]
    average = logsumexp(odds, b=np.array(weights) / np.sum(weights))
    assert found.p_wrong == pytest.approx(1 / (1 + np.exp(-average)), rel=1e-5)
    halves = []
    for lenses, p in ((1.0, found.p_wrong), (0.0, 1 - found.p_wrong)):
        size = SIZE * np.where(k < AT_FOCAL, lenses, 1.0)
        held, cov = considered(views, size, trusted, refocused)
        halves.append((p, held, cov + np.outer(held, held)))
    mean = sum(p * m for p, m, _ in halves)
    cov = sum(p * second for p, _, second in halves) - np.outer(mean, mean)
    assert np.abs(found.mean - mean).max() < 1e-6
    assert np.abs(found.cov - cov).max() < 1e-6
    known = mixture(views.mean, views.cov, SIZE, rules, known_wrong=True, spread=spread, refocused=refocused)
    assert known.p_wrong == 1 and np.abs(known.mean - halves[0][1]).max() < 1e-6
