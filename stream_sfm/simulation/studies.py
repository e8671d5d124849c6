"""Studies: Monte Carlo trials in one or many processes, and their reports.

The same seed gives the same numbers. Ratios, means and exponents over trials have a 95 % interval by bootstrap over
whole trials. The conditions of two studies are here: efficiency (variance over the bound) and consistency (normalised
errors).
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import msgspec
import numpy as np

from ..evaluation.relative import Interval
from ..geometry import Array
from ..methods import COMPARED, METHODS, REFERENCE, WITHOUT_IMU
from .measure import NORMALISED, QUANTITIES, Measured, Method, measure
from .scenes import Scene

EXPECTED = dict(zip(NORMALISED, (6.0, 3.0, 3.0), strict=True))
Progress = Callable[[int], None]  # called with the number of trials just finished
Report = dict[str, Any]
Pool = Callable[[], AbstractContextManager[Executor | None]]  # starts an executor; None: in this process


class Outcome(NamedTuple):
    """The report of a study, and of how many trials it is."""

    report: Report
    trials: int


def _run_all(
    jobs: Mapping[str, tuple[Callable[[np.random.SeedSequence], Measured], int]],
    seed: int,
    executor: Executor | None,
    progress: Progress | None,
    kept: dict[str, list[Measured]],
) -> None:
    """Run jobs, each with a number of trials, so that all of them are always at the same share of these.

    `kept` gets each result as soon as it is there, so that they survive an interruption.
    """
    seeds = {name: np.random.SeedSequence(seed).spawn(trials) for name, (_, trials) in jobs.items()}
    order = sorted(((n + 1) / len(of), name, n) for name, of in seeds.items() for n in range(len(of)))
    calls = [(name, jobs[name][0], seeds[name][n]) for _, name, n in order]
    # not `executor.map`: it cancels what an interruption leaves, and a pool that is killed then reports an error
    asked = [executor.submit(job, own) for _, job, own in calls] if executor else None
    for k, (name, job, own) in enumerate(calls):
        kept[name].append(job(own) if asked is None else asked[k].result())
        if progress:
            progress(1)


def stacked(trials: list[Measured]) -> Measured:
    """Return the measurements of all trials, (trials, k) each."""
    return {
        label: {name: np.stack([t[label][name] for t in trials]) for name in trials[0][label]} for label in trials[0]
    }


def trials_of(data: Measured) -> int:
    return len(next(iter(next(iter(data.values())).values())))


@dataclass(frozen=True, slots=True)
class Job:
    """The picklable measurement of one trial; the fraction `share` of the requested trials is run."""

    measure: Callable[[np.random.SeedSequence], Measured]
    share: float = 1.0

    def trials(self, asked: int) -> int:
        """Return the number of trials: at least two, which an interval needs, unless one was requested."""
        return max(2, round(asked * self.share)) if asked > 1 else 1


@dataclass(frozen=True, slots=True)
class Study:
    """Jobs by name, and the report on their measurements."""

    jobs: Callable[[], Mapping[str, Job]]
    report: Callable[[dict[str, Measured]], Report]

    def total_trials(self, trials: int) -> int:
        return sum(job.trials(trials) for job in self.jobs().values())

    def run(self, trials: int, seed: int, pool: Pool = nullcontext, progress: Progress | None = None) -> Outcome:
        """Run all jobs in a `pool`, or in this process.

        After an interruption, the report is on the trials finished so far. Raises KeyboardInterrupt if a job has fewer
        than two of them, which an interval needs.
        """
        jobs = {name: (job.measure, job.trials(trials)) for name, job in self.jobs().items()}
        kept: dict[str, list[Measured]] = {name: [] for name in jobs}
        try:
            with pool() as executor:
                _run_all(jobs, seed, executor, progress, kept)
        except KeyboardInterrupt:
            if any(len(kept[name]) < min(2, wanted) for name, (_, wanted) in jobs.items()):
                raise
        share = min(len(kept[name]) / wanted for name, (_, wanted) in jobs.items())
        return Outcome(self.report({name: stacked(found) for name, found in kept.items()}), int(share * trials))


def _bootstrap(statistic: Callable[[Array], Array], n: int) -> Interval:
    """Bootstrap a `statistic` that takes weights (r, n) of n trials, whose rows sum to n, and returns (r,)."""
    rng = np.random.default_rng(0)
    # 2000: σ of the ends of an interval is then 1.5 % of its length
    weights = rng.multinomial(n, np.full(n, 1 / n), size=2000).astype(float)
    value = float(statistic(np.ones((1, n)))[0])
    if n < 2:
        return Interval(value, value, value)
    low, high = np.nanpercentile(statistic(weights), [2.5, 97.5])
    return Interval(value, float(low), float(high))


def ratio(numerator: Array, denominator: Array) -> Interval:
    """Return the ratio of two sums (trials, frames) over the same trials; frames with a NaN (lost) are left out."""
    valid = np.isfinite(numerator) & np.isfinite(denominator)
    a = np.where(valid, numerator, 0).sum(axis=1)
    b = np.where(valid, denominator, 0).sum(axis=1)
    return _bootstrap(lambda w: (w @ a) / (w @ b), len(a))


def mean(values: Array) -> Interval:
    """Return the mean over trials and frames (trials, frames) without NaN."""
    return ratio(values, np.where(np.isfinite(values), 1.0, np.nan))


def exponent(x: Array, values: Array) -> Interval:
    """Return the slope of log(mean over trials of `values` (trials, len(x))) against log x (len(x),), least squares."""
    log_x = np.log(np.asarray(x, dtype=float))
    centred = log_x - log_x.mean()
    slope = centred / (centred @ centred)
    return _bootstrap(lambda w: np.log(w @ values / w.sum(axis=1, keepdims=True)) @ slope, len(values))


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition(Job):
    """A job with trials of one scene, in which estimators are judged at `frames`."""

    scene: Scene
    frames: tuple[int, ...]


def of_conditions(
    conditions: Mapping[str, Condition], evaluate: Callable[[dict[str, Array], Measured], Report], **known: Any
) -> Study:
    """Make a study that reports its conditions, and for each estimator `evaluate` and the share of lost frames.

    `evaluate` gets the measurements of the estimator and of all; `known` is part of the report.
    """

    def part(name: str, data: Measured) -> Report:
        of_each = {
            label: {**evaluate(entry, data), "lost_share": float(np.isnan(entry["rotation"]).mean())}
            for label, entry in data.items()
            if label != "bound"
        }
        ran = {"frames": list(conditions[name].frames), "scene": msgspec.to_builtins(conditions[name].scene)}
        return {"trials": trials_of(data), **ran, "estimators": of_each}

    def report(measured: dict[str, Measured]) -> Report:
        return {**known, "conditions": {name: part(name, data) for name, data in measured.items()}}

    return Study(lambda: conditions, report)


# Simulated logs have no inertial samples.
_SIMULATED = tuple(Method(name) for name in METHODS if name != WITHOUT_IMU)


def judged(
    scene: Scene,
    frames: tuple[int, ...],
    methods: Sequence[Method] = _SIMULATED,
    bound: bool = True,
    share: float = 1.0,
) -> Condition:
    """Return a condition in which methods are judged, with or without the bound."""
    trial = partial(measure, scene=scene, methods=methods, frames=frames, bound=bound)
    return Condition(trial, share, scene=scene, frames=frames)


_OF_LONG_RUNS = tuple(Method(name) for name in COMPARED if name != "ekf-cv")
_FRAMES, _LATE_FRAMES = tuple(range(10, 31)), tuple(range(20, 201, 20))
CONDITIONS = {
    "nominal": judged(Scene(track_length=8), _FRAMES),
    "noise_1.155px": judged(Scene(track_length=8, std_px=1.155, round_off=False), _FRAMES, share=0.5),
    "200_frames": judged(Scene(frames=201, track_length=8), _LATE_FRAMES, _OF_LONG_RUNS, bound=False, share=0.5),
}


def _efficiency(entry: dict[str, Array], data: Measured) -> Report:
    """Return the variance of an estimator over that of the default, paired, and over the bound."""
    over = {"over_reference": {q: ratio(entry[q], data[REFERENCE][q]) for q in QUANTITIES}}
    if "bound_rotation" in entry:
        over["over_bound"] = {q: ratio(entry[q], entry[f"bound_{q}"]) for q in QUANTITIES}
    return over


def _consistency(entry: dict[str, Array], data: Measured) -> Report:
    """Return the mean normalised squared errors of an estimator."""
    return {name: mean(entry[name]) for name in NORMALISED}


EFFICIENCY = of_conditions(CONDITIONS, _efficiency, reference=REFERENCE)
CONSISTENCY = of_conditions(CONDITIONS, _consistency, reference=REFERENCE, expected=EXPECTED)
