"""Efficiency (variance over the bound) and consistency (normalised errors) of every estimator."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import Any

import msgspec

from ..estimators import METHODS
from ..geometry.se3 import Array
from .measure import NORMALISED, QUANTITIES, Method, measure, stacked
from .scenes import Scene
from .statistics import mean, ratio
from .trials import Progress, run_trials

REFERENCE = "cross-frame"
EXPECTED = dict(zip(NORMALISED, (6.0, 3.0, 3.0), strict=True))


@dataclass(frozen=True, slots=True)
class Condition:
    """A scene in which estimators are compared at `frames`; of the trials asked for, the fraction `share` is run."""

    name: str
    scene: Scene
    methods: tuple[Method, ...]
    frames: tuple[int, ...]
    share: float = 1.0
    bound: bool = True

    def trials(self, asked: int) -> int:
        """Return how many trials are run."""
        return max(2, round(asked * self.share)) if asked > 1 else 1


ALL = tuple(Method(name) for name in METHODS)
_MAIN = tuple(
    Method(name)
    for name in (REFERENCE, "cross-frame-wc", "cross-frame-cc", "ekf", "iterated-ekf", "frame-to-frame")
)
NOMINAL = Condition("nominal", Scene(track_length=8), ALL, tuple(range(10, 31)))
NOISY = Condition(
    "noise_1.155px", Scene(track_length=8, std_px=1.155, round_off=False), ALL, tuple(range(10, 31)), share=0.5
)
LONG = Condition(
    "200_frames", Scene(frames=201, track_length=8), _MAIN, tuple(range(20, 201, 20)), share=0.5, bound=False
)

Report = dict[str, Any]


def _run(
    condition: Condition, trials: int, seed: int, executor: Executor | None, progress: Progress | None
) -> dict[str, dict[str, Array]]:
    job = partial(
        measure,
        scene=condition.scene,
        methods=condition.methods,
        frames=condition.frames,
        bound=condition.bound,
    )
    return stacked(run_trials(job, condition.trials(trials), seed, executor, progress))


def _lost_share(entry: dict[str, Array]) -> float:
    return float((entry["rotation"] != entry["rotation"]).mean())


def _efficiency_of(data: dict[str, dict[str, Array]]) -> Report:
    reference = data[REFERENCE]
    report: Report = {}
    for label, entry in data.items():
        if label == "bound":
            continue
        report[label] = {
            "over_reference": {q: ratio(entry[q], reference[q]) for q in QUANTITIES},
            "lost_share": _lost_share(entry),
        }
        if "bound" in data:
            report[label]["over_bound"] = {q: ratio(entry[q], entry[f"bound_{q}"]) for q in QUANTITIES}
    return report


def _consistency_of(data: dict[str, dict[str, Array]]) -> Report:
    return {
        label: {name: mean(entry[name]) for name in NORMALISED} | {"lost_share": _lost_share(entry)}
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
    return _study("efficiency", _efficiency_of, conditions or (NOMINAL, NOISY, LONG))(
        trials, seed, executor, progress
    )


def consistency(
    trials: int,
    seed: int,
    executor: Executor | None,
    progress: Progress | None = None,
    conditions: tuple[Condition, ...] = (),
) -> Report:
    """Measure the mean normalised squared errors of each estimator; by condition."""
    return _study("consistency", _consistency_of, conditions or (NOMINAL, NOISY, LONG))(
        trials, seed, executor, progress
    ) | {"expected": EXPECTED}


def _study(
    name: str, evaluate: Callable[[dict[str, dict[str, Array]]], Report], conditions: tuple[Condition, ...]
) -> Callable[[int, int, Executor | None, Progress | None], Report]:
    def run(trials: int, seed: int, executor: Executor | None, progress: Progress | None) -> Report:
        report: Report = {"experiment": name, "seed": seed, "reference": REFERENCE, "conditions": {}}
        for condition in conditions:
            data = _run(condition, trials, seed, executor, progress)
            report["conditions"][condition.name] = {
                "trials": condition.trials(trials),
                "frames": list(condition.frames),
                "scene": msgspec.to_builtins(condition.scene),
                "estimators": evaluate(data),
            }
        return report

    return run


def total_trials(trials: int, conditions: tuple[Condition, ...] = (NOMINAL, NOISY, LONG)) -> int:
    """Return how many trials a study runs altogether."""
    return sum(c.trials(trials) for c in conditions)
