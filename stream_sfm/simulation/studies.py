"""Efficiency (variance over the bound) and consistency (normalised errors) of every estimator."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..estimators import METHODS
from . import conditions
from .conditions import Measured, Report, by_condition, lost_share
from .measure import NORMALISED, QUANTITIES, Method, measure
from .scenes import Scene
from .statistics import mean, ratio
from .trials import Progress

REFERENCE = "cross-frame"
EXPECTED = dict(zip(NORMALISED, (6.0, 3.0, 3.0), strict=True))


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition(conditions.Condition):
    """A scene in which estimators are compared, with each other and with the bound or not."""

    methods: tuple[Method, ...]
    bound: bool = True

    def job(self) -> Callable[[np.random.SeedSequence], Measured]:
        """Return the measurement of one sequence of the scene."""
        return partial(measure, scene=self.scene, methods=self.methods, frames=self.frames, bound=self.bound)


ALL = tuple(Method(name) for name in METHODS)
_MAIN = tuple(
    Method(name)
    for name in (REFERENCE, "cross-frame-wc", "cross-frame-cc", "ekf", "iterated-ekf", "frame-to-frame")
)
_NOISY = Scene(track_length=8, std_px=1.155, round_off=False)
CONDITIONS = (
    Condition("nominal", Scene(track_length=8), tuple(range(10, 31)), methods=ALL),
    Condition("noise_1.155px", _NOISY, tuple(range(10, 31)), share=0.5, methods=ALL),
    Condition(
        "200_frames",
        Scene(frames=201, track_length=8),
        tuple(range(20, 201, 20)),
        share=0.5,
        methods=_MAIN,
        bound=False,
    ),
)


def _efficiency_of(data: Measured) -> Report:
    reference = data[REFERENCE]
    report: Report = {}
    for label, entry in data.items():
        if label == "bound":
            continue
        report[label] = {
            "over_reference": {q: ratio(entry[q], reference[q]) for q in QUANTITIES},
            "lost_share": lost_share(entry),
        }
        if "bound" in data:
            report[label]["over_bound"] = {q: ratio(entry[q], entry[f"bound_{q}"]) for q in QUANTITIES}
    return report


def _consistency_of(data: Measured) -> Report:
    return {
        label: {name: mean(entry[name]) for name in NORMALISED} | {"lost_share": lost_share(entry)}
        for label, entry in data.items()
        if label != "bound"
    }


def efficiency(
    trials: int,
    seed: int,
    executor: Executor | None,
    progress: Progress | None = None,
    conditions: tuple[Condition, ...] = (),
) -> Report:
    """Measure the variance of each estimator over the bound and, paired, over the default's; by condition."""
    parts = by_condition(conditions or CONDITIONS, _efficiency_of, trials, seed, executor, progress)
    return {"experiment": "efficiency", "seed": seed, "reference": REFERENCE, "conditions": parts}


def consistency(
    trials: int,
    seed: int,
    executor: Executor | None,
    progress: Progress | None = None,
    conditions: tuple[Condition, ...] = (),
) -> Report:
    """Measure the mean normalised squared errors of each estimator; by condition."""
    parts = by_condition(conditions or CONDITIONS, _consistency_of, trials, seed, executor, progress)
    head = {"experiment": "consistency", "seed": seed, "reference": REFERENCE}
    return {**head, "conditions": parts, "expected": EXPECTED}


def total_trials(trials: int) -> int:
    """Return how many trials each of the two studies runs altogether."""
    return conditions.total_trials(trials, CONDITIONS)
