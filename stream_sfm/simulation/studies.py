"""Efficiency (variance over the bound) and consistency (normalised errors) of every estimator, under conditions."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import msgspec
import numpy as np

from ..estimators import METHODS
from ..geometry.se3 import Array
from .measure import NORMALISED, QUANTITIES, Method, measure
from .scenes import Scene
from .statistics import mean, ratio
from .trials import Job, Measured, Report, Study, trials_of

REFERENCE = "cross-frame"
EXPECTED = dict(zip(NORMALISED, (6.0, 3.0, 3.0), strict=True))


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """A scene in which `methods` are judged at `frames`, with the bound or not; run in a `share` of the trials."""

    scene: Scene
    frames: tuple[int, ...]
    methods: tuple[Method, ...] = tuple(Method(name) for name in METHODS)
    bound: bool = True
    share: float = 1.0

    def job(self) -> Job:
        """Return what one trial measures."""
        run = partial(measure, scene=self.scene, methods=self.methods, frames=self.frames, bound=self.bound)
        return Job(run, self.share)


_OF_LONG_RUNS = (REFERENCE, "cross-frame-wc", "cross-frame-cc", "ekf", "iterated-ekf", "frame-to-frame")
CONDITIONS = {
    "nominal": Condition(scene=Scene(track_length=8), frames=tuple(range(10, 31))),
    "noise_1.155px": Condition(
        scene=Scene(track_length=8, std_px=1.155, round_off=False), frames=tuple(range(10, 31)), share=0.5
    ),
    "200_frames": Condition(
        scene=Scene(frames=201, track_length=8),
        frames=tuple(range(20, 201, 20)),
        methods=tuple(Method(name) for name in _OF_LONG_RUNS),
        bound=False,
        share=0.5,
    ),
}


def condition_report(
    scene: Scene, frames: tuple[int, ...], data: Measured, evaluate: Callable[[dict[str, Array]], Report]
) -> Report:
    """Return what was run under a condition, and of each estimator the evaluation and the share of frames lost."""
    estimators = {
        label: {**evaluate(entry), "lost_share": float(np.isnan(entry["rotation"]).mean())}
        for label, entry in data.items()
        if label != "bound"
    }
    return {
        "trials": trials_of(data),
        "frames": list(frames),
        "scene": msgspec.to_builtins(scene),
        "estimators": estimators,
    }


def _jobs() -> dict[str, Job]:
    return {name: condition.job() for name, condition in CONDITIONS.items()}


def _efficiency(measured: dict[str, Measured]) -> Report:
    """Report the variance of each estimator over the bound and, paired, over the default's; by condition."""
    parts = {}
    for name, data in measured.items():
        condition, reference = CONDITIONS[name], data[REFERENCE]

        def evaluate(entry: dict[str, Array], reference: dict[str, Array] = reference) -> Report:
            over = {"over_reference": {q: ratio(entry[q], reference[q]) for q in QUANTITIES}}
            if "bound_rotation" in entry:
                over["over_bound"] = {q: ratio(entry[q], entry[f"bound_{q}"]) for q in QUANTITIES}
            return over

        parts[name] = condition_report(condition.scene, condition.frames, data, evaluate)
    return {"reference": REFERENCE, "conditions": parts}


def _consistency(measured: dict[str, Measured]) -> Report:
    """Report the mean normalised squared errors of each estimator; by condition."""

    def evaluate(entry: dict[str, Array]) -> Report:
        return {name: mean(entry[name]) for name in NORMALISED}

    parts = {
        name: condition_report(CONDITIONS[name].scene, CONDITIONS[name].frames, data, evaluate)
        for name, data in measured.items()
    }
    return {"reference": REFERENCE, "conditions": parts, "expected": EXPECTED}


EFFICIENCY, CONSISTENCY = Study(_jobs, _efficiency), Study(_jobs, _consistency)
