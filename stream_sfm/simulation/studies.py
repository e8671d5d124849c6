"""Studies of estimators under conditions: efficiency (variance over the bound) and consistency (normalised errors)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import msgspec
import numpy as np

from ..estimators import METHODS
from ..geometry.se3 import Array
from .measure import NORMALISED, QUANTITIES, Method, measure
from .scenes import Scene
from .trials import Job, Measured, Report, Study, mean, ratio, trials_of

REFERENCE = "cross-frame"
EXPECTED = dict(zip(NORMALISED, (6.0, 3.0, 3.0), strict=True))


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition(Job):
    """A job whose trials are of one scene, in which estimators are judged at `frames`."""

    scene: Scene
    frames: tuple[int, ...]


def of_conditions(
    conditions: Mapping[str, Condition], evaluate: Callable[[dict[str, Array], Measured], Report], **known: Any
) -> Study:
    """Make a study that reports, for each condition, what was run, and of each estimator what `evaluate` returns and
    the share of frames lost.

    `evaluate` is given the measurements of the estimator and of all; `known` is part of the report.
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


def judged(
    scene: Scene,
    frames: tuple[int, ...],
    methods: Sequence[Method] = tuple(map(Method, METHODS)),
    bound: bool = True,
    share: float = 1.0,
) -> Condition:
    """A condition in which methods are judged, with the bound or not."""
    trial = partial(measure, scene=scene, methods=methods, frames=frames, bound=bound)
    return Condition(trial, share, scene=scene, frames=frames)


_OF_LONG_RUNS = tuple(
    map(Method, (REFERENCE, "cross-frame-wc", "cross-frame-cc", "ekf", "iterated-ekf", "frame-to-frame"))
)
_FRAMES, _LATE_FRAMES = tuple(range(10, 31)), tuple(range(20, 201, 20))
CONDITIONS = {
    "nominal": judged(Scene(track_length=8), _FRAMES),
    "noise_1.155px": judged(Scene(track_length=8, std_px=1.155, round_off=False), _FRAMES, share=0.5),
    "200_frames": judged(Scene(frames=201, track_length=8), _LATE_FRAMES, _OF_LONG_RUNS, bound=False, share=0.5),
}


def _efficiency(entry: dict[str, Array], data: Measured) -> Report:
    """The variance of an estimator over that of the default, paired, and over the bound."""
    over = {"over_reference": {q: ratio(entry[q], data[REFERENCE][q]) for q in QUANTITIES}}
    if "bound_rotation" in entry:
        over["over_bound"] = {q: ratio(entry[q], entry[f"bound_{q}"]) for q in QUANTITIES}
    return over


def _consistency(entry: dict[str, Array], data: Measured) -> Report:
    """The mean normalised squared errors of an estimator."""
    return {name: mean(entry[name]) for name in NORMALISED}


EFFICIENCY = of_conditions(CONDITIONS, _efficiency, reference=REFERENCE)
CONSISTENCY = of_conditions(CONDITIONS, _consistency, reference=REFERENCE, expected=EXPECTED)
