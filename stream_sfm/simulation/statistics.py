"""Ratios, means and exponents over trials, each with a 95 % interval by bootstrap over whole trials."""

from collections.abc import Callable

import numpy as np

from ..evaluation.relative import Interval
from ..geometry.se3 import Array

_RESAMPLES = 2000  # closed form: the ends of an interval then have a σ of 1.5 % of its length
_PERCENTILES = [2.5, 97.5]


def _bootstrap(statistic: Callable[[Array], Array], n: int) -> Interval:
    """Bootstrap a `statistic` that takes weights (r, n) of n trials, whose rows sum to n, and returns (r,)."""
    rng = np.random.default_rng(0)
    weights = rng.multinomial(n, np.full(n, 1 / n), size=_RESAMPLES).astype(float)
    value = float(statistic(np.ones((1, n)))[0])
    if n < 2:
        return Interval(value, value, value)
    low, high = np.nanpercentile(statistic(weights), _PERCENTILES)
    return Interval(value, float(low), float(high))


def ratio(numerator: Array, denominator: Array) -> Interval:
    """Return the sum of `numerator` over that of `denominator`, both (trials, frames) of the same trials (paired).

    Frames where either is NaN (lost) are left out of both.
    """
    valid = np.isfinite(numerator) & np.isfinite(denominator)
    a = np.where(valid, numerator, 0).sum(axis=1)
    b = np.where(valid, denominator, 0).sum(axis=1)
    return _bootstrap(lambda w: (w @ a) / (w @ b), len(a))


def mean(values: Array) -> Interval:
    """Return the mean over trials and frames (trials, frames), NaN left out."""
    return ratio(values, np.where(np.isfinite(values), 1.0, np.nan))


def exponent(x: Array, values: Array) -> Interval:
    """Return the slope of log(mean over trials of `values` (trials, len(x))) against log x (len(x),), least squares."""
    log_x = np.log(np.asarray(x, dtype=float))
    centred = log_x - log_x.mean()
    slope = centred / (centred @ centred)
    return _bootstrap(lambda w: np.log(w @ values / w.sum(axis=1, keepdims=True)) @ slope, len(values))
