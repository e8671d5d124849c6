"""How large the errors of a rig are, by marginal likelihood, and how probable it is that there are none.

The joint posterior N(ĉ, C) of the errors under a working prior N(0, diag(s²)) says what all views said: their
likelihood is a Gaussian of information Λ = C⁻¹ − diag(s⁻²) and weighted sum η = C⁻¹ĉ. With it any other prior can be
compared, without looking at a view again.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..geometry.linear import symmetric, symmetric_inverse
from ..geometry.se3 import Array
from .terms import DELAY, FOCAL, FOCUSING, READOUT, TERMS, TURNING

# Sizes that are considered, all equally probable: from those of rendered images to three times of what is assumed.
_SIZES = np.geomspace(0.025, 3.0, 41)
_LENS = slice(0, TERMS.index(FOCAL))  # what calibrations have wrong together, or have not
_FOCAL = TERMS.index(FOCAL)
# What noise shows of the other terms is considered only. Beforehand: of twenty rigs one has a wrong focal length, one a
# delay, and one a rolling shutter; of two hundred one turns, and of one the focus moves.
_CONSIDERED = slice(_FOCAL, len(TERMS))
_ODDS = {(FOCAL,): 0.05, (DELAY,): 0.05, (READOUT,): 0.05, TURNING: 0.005, (FOCUSING,): 0.005}
_IS_ZERO = np.array(  # (32, 7): which terms are 0, in each combination of those that may be
    [
        [zero for terms, zero in zip(_ODDS, combination, strict=True) for _ in terms]
        for combination in product((False, True), repeat=len(_ODDS))
    ]
)
_LOG_PRIOR = np.array(
    [
        sum(np.log(odds) for odds, zero in zip(_ODDS.values(), combination, strict=True) if not zero)
        for combination in product((False, True), repeat=len(_ODDS))
    ]
)
_ALONE = 0.05  # of wrong calibrations are wrong in one term only
# Of the information that views claim about these terms, the share that counts for whether they are wrong at all: errors
# that last, and those of neighbours, make their σ half of what it should be (simulated 1.4, real 1.5 to 4.5 times).
_COUNTS = 0.25
_MAX_ODDS = 500.0  # log odds: exp stays finite


@dataclass(frozen=True, slots=True)
class Mixture:
    """Errors c as a mixture over what may be exactly zero: `mean` (m,), `cov` (m, m) and `p_wrong`, that c is not 0."""

    mean: Array
    cov: Array
    p_wrong: float


def log_evidence(information: Array, weighted: Array, variance: Array | float = 1.0) -> Array:
    """Return by how much likelier errors are N(0, `variance`) than 0, as a logarithm, eq. (72a).

    Of independent ones, from the information that views have about each and their sum weighted by it; all of one shape.
    """
    ratio = variance * information
    return np.asarray(0.5 * (variance * weighted**2 / (1 + ratio) - np.log1p(ratio)))


def likely_sizes(mean: Array, cov: Array, size: Array) -> Array:
    """Return the size of each physical term that views make likely, from N(`mean`, `cov`) with sizes so far, eq. (72a).

    Each by itself: a readout of 20 ms says nothing about lenses. The focal length keeps its own.
    """
    var = np.diag(cov)[: len(TERMS)]
    information = np.maximum(1 / var - size[: len(TERMS)] ** -2.0, 0.0)
    weighted = mean[: len(TERMS)] / var
    s2 = (_SIZES**2)[:, None]
    evidence = log_evidence(information, weighted, s2)
    weight = np.exp(evidence - evidence.max(axis=0))
    result = size.copy()
    result[: len(TERMS)] = np.sqrt((weight * s2).sum(axis=0) / weight.sum(axis=0))
    result[_FOCAL] = size[_FOCAL]
    return result


def log_odds_wrong(mean: Array, cov: Array, size: Array, which: slice) -> float:
    """Return the log odds that the errors `which` are N(0, 1) each rather than all 0.

    Both are equally probable beforehand. By the ratio of densities at zero, posterior and prior (Dickey 1971).
    """
    own, var = mean[which], cov[which, which]
    information = symmetric_inverse(var)
    views = symmetric(information - np.diag(size[which] ** -2.0))
    values, axes = np.linalg.eigh(views)
    return float(log_evidence(np.maximum(values, 0.0), axes.T @ (information @ own)).sum())


def log_odds_lenses(mean: Array, cov: Array, size: Array) -> float:
    """Return the log odds that lenses have errors rather than none: in all their terms, or in any one of them alone.

    One wrong calibration in twenty has one wrong term, as where the right camera has been turned.
    """
    information = symmetric_inverse(cov[_LENS, _LENS])
    views = np.maximum(np.diag(information) - size[_LENS] ** -2.0, 0.0)
    alone = log_evidence(views, information @ mean[_LENS])
    together = log_odds_wrong(mean, cov, size, _LENS)
    largest = max(together, float(alone.max()))
    likelihoods = (1 - _ALONE) * np.exp(together - largest) + _ALONE * np.exp(alone - largest).mean()
    return largest + float(np.log(likelihoods))


def mixture(mean: Array, cov: Array, size: Array, known_wrong: bool = False) -> Mixture:
    """Return the errors by N(`mean`, `cov`), where lenses with their field, or each of the other terms, may have none.

    What turns show of the focal length or of a delay, noise shows, too: until one is probable, it counts in the
    covariance in full.
    """
    lens = np.r_[_LENS, len(TERMS) : len(mean)]
    combinations = _combinations(mean, cov, size)
    zero = _CONSIDERED.start + np.flatnonzero(_IS_ZERO[combinations[0].argmax()])
    log_odds = log_odds_lenses(*_without(mean, cov, zero), size)  # free rates and times would do for lenses, too
    p_wrong = float(probability(np.array(log_odds)))
    wrong = _considering(mean, cov, *combinations)
    if known_wrong:
        return Mixture(*wrong, 1.0)
    mean, cov = _without(mean, cov, lens)
    right = _considering(mean, cov, *_combinations(mean, cov, size))
    return Mixture(*_either(p_wrong, wrong, right), p_wrong)


def _considering(mean: Array, cov: Array, weights: Array, weighted: Array) -> tuple[Array, Array]:
    """Return mean and covariance of errors where focal length, timing and rates are as wrong as is probable.

    By their `_combinations`. They count in full in the covariance.
    """
    away = cov[:, _CONSIDERED] @ (weights @ weighted)
    return mean - away, cov + np.outer(away, away)


def _combinations(mean: Array, cov: Array, size: Array) -> tuple[Array, Array]:
    """Return the probability (32,) of each combination of terms that are 0, and C⁻¹ĉ (32, 7) of these terms.

    By the ratio of their densities there (Dickey 1971), with N(0, 1) for those that are not 0.
    """
    own = np.where(
        _IS_ZERO[:, :, None] & _IS_ZERO[:, None], cov[_CONSIDERED, _CONSIDERED], np.eye(_IS_ZERO.shape[1])
    )
    information = np.linalg.inv(own) * _IS_ZERO[:, None]
    weighted = information @ mean[_CONSIDERED]
    prior = np.where(_IS_ZERO, size[_CONSIDERED] ** -2.0, 0.0)
    values, axes = np.linalg.eigh(symmetric(information - prior[:, :, None] * np.eye(len(prior[0]))))
    values = _COUNTS * np.maximum(values, 0.0)
    along = _COUNTS * (weighted[:, None] @ axes)[:, 0]
    log_p = _LOG_PRIOR - log_evidence(values, along).sum(axis=1)
    p = np.exp(log_p - log_p.max())
    return p / p.sum(), weighted


def _without(mean: Array, cov: Array, which: NDArray[np.intp]) -> tuple[Array, Array]:
    """Return mean and covariance of errors, given that those of `which` are 0."""
    others = np.setdiff1d(np.arange(len(mean)), which)
    block = np.ix_(others, others)
    gain = np.linalg.solve(cov[np.ix_(which, which)], cov[np.ix_(which, others)]).T
    given, cov_given = np.zeros_like(mean), np.zeros_like(cov)
    given[others] = mean[others] - gain @ mean[which]
    cov_given[block] = symmetric(cov[block] - gain @ cov[np.ix_(which, others)])
    return given, cov_given


def _either(p: float, one: tuple[Array, Array], other: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return mean and covariance of a mixture of two Gaussians, the first with probability p."""
    apart = one[0] - other[0]
    cov = p * one[1] + (1 - p) * other[1] + p * (1 - p) * np.outer(apart, apart)
    return p * one[0] + (1 - p) * other[0], cov


def probability(log_odds: Array) -> Array:
    """Return the probabilities of log odds, both of any shape."""
    return 1 / (1 + np.exp(-np.clip(log_odds, -_MAX_ODDS, _MAX_ODDS)))
