"""Monte-Carlo trials in this process or in many, and studies made of them: the same seed gives the same numbers.

Ratios, means and exponents over trials have a 95 % interval by bootstrap over whole trials.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from ..evaluation.relative import Interval
from ..geometry.se3 import Array

Result = TypeVar("Result")
Progress = Callable[[int], None]  # called with the number of trials just finished
Measured = dict[str, dict[str, Array]]  # label -> quantity -> values (k,) of one trial, (trials, k) of all
Report = dict[str, Any]


def run_trials(
    job: Callable[[np.random.SeedSequence], Result],
    trials: int,
    seed: int,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> list[Result]:
    """Return `job` of each trial's own seed, in the order of trials, run by `executor` or (None) in this process.

    `job` must be picklable: a function of a module, or functools.partial of one.
    """
    seeds = np.random.SeedSequence(seed).spawn(trials)
    results: list[Result] = []
    for result in executor.map(job, seeds) if executor else map(job, seeds):
        results.append(result)
        if progress:
            progress(1)
    return results


def stacked(trials: list[Measured]) -> Measured:
    """Return the measurements of all trials, (trials, k) each."""
    return {
        label: {name: np.stack([t[label][name] for t in trials]) for name in trials[0][label]}
        for label in trials[0]
    }


def trials_of(data: Measured) -> int:
    """Return the number of trials that were measured."""
    return len(next(iter(next(iter(data.values())).values())))


@dataclass(frozen=True, slots=True)
class Job:
    """The measurement of one trial, picklable; of the trials asked for, the fraction `share` is run."""

    measure: Callable[[np.random.SeedSequence], Measured]
    share: float = 1.0

    def trials(self, asked: int) -> int:
        """Return how many trials are run: at least two, which an interval needs, unless one was asked for."""
        return max(2, round(asked * self.share)) if asked > 1 else 1


@dataclass(frozen=True, slots=True)
class Study:
    """Jobs by name, and the report that is made of the measurements of each."""

    jobs: Callable[[], Mapping[str, Job]]
    report: Callable[[dict[str, Measured]], Report]

    def total_trials(self, trials: int) -> int:
        """Return how many trials are run altogether."""
        return sum(job.trials(trials) for job in self.jobs().values())

    def run(
        self, trials: int, seed: int, executor: Executor | None = None, progress: Progress | None = None
    ) -> Report:
        """Run all jobs, and return their report."""
        measured = {
            name: stacked(run_trials(job.measure, job.trials(trials), seed, executor, progress))
            for name, job in self.jobs().items()
        }
        return self.report(measured)


def _bootstrap(statistic: Callable[[Array], Array], n: int) -> Interval:
    """Bootstrap a `statistic` that takes weights (r, n) of n trials, whose rows sum to n, and returns (r,)."""
    rng = np.random.default_rng(0)
    # 2000: the ends of an interval then have a σ of 1.5 % of its length
    weights = rng.multinomial(n, np.full(n, 1 / n), size=2000).astype(float)
    value = float(statistic(np.ones((1, n)))[0])
    if n < 2:
        return Interval(value, value, value)
    low, high = np.nanpercentile(statistic(weights), [2.5, 97.5])
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
