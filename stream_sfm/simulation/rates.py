"""Table 1 of the paper: how error variances grow with the frame number n, the span k of a track, the window b.

For every entry: the paper's rate, the measured exponent, and what exact theory (the Cramér–Rao bound of the same
trials) says. Simple: a point is seen in L = 2 frames; general: L = 8; non-transitory: in all. k = L/2.
"""

from concurrent.futures import Executor
from functools import partial
from typing import Any

import msgspec
import numpy as np

from ..estimators.baselines.full_batch import cramer_rao_bound
from ..geometry.se3 import Array
from .measure import QUANTITIES, Method, measure, stacked
from .motions import MOTIONS
from .scenes import Scene
from .statistics import Interval, exponent, mean, ratio
from .trials import Progress, run_trials

METHOD = Method("cross-frame")
READINGS = (METHOD, Method("cross-frame-wc"), Method("cross-frame-cc"))  # the joint window; the paper's WC and CC
BATCHES = (1, 2, 4, 8)  # b of the estimators, as in the paper's figure
SPANS = (2, 4, 8, 16)  # L of the drift rates
WINDOWS = (1, 2, 4, 8, 16)  # b of the structure law, at L = 16
LAST_FRAMES = tuple(range(20, 31, 2))  # over which variances of the estimators are taken
_DRIFT_FRAMES = (32, 96)  # between them drift is measured: twice the longest span and more from the start
_BOUND_FRACTION = 0.08  # of the trials: the bound is costly, and varies little between scenes


class Run(msgspec.Struct, frozen=True):
    """A sequence of the table: exponents are fitted over `frames` of a scene."""

    title: str
    scene: Scene
    frames: tuple[int, ...]


_SLOW, _LATERAL = MOTIONS["slow"], MOTIONS["lateral"]
RUNS = {
    "non_transitory_slow": Run(
        "non-transitory, 10 mm per frame", Scene(motion=_SLOW, track_length=31), tuple(range(1, 31))
    ),
    "simple_slow": Run("simple, 10 mm per frame", Scene(motion=_SLOW, track_length=2), tuple(range(1, 31))),
    "simple_lateral": Run(
        "simple, 200 mm per frame", Scene(frames=81, motion=_LATERAL, track_length=2), tuple(range(20, 81, 4))
    ),
    "general_slow": Run("general L = 8, 10 mm per frame", Scene(motion=_SLOW, track_length=8), tuple(range(8, 31))),
    "general_lateral": Run(
        "general L = 8, 200 mm per frame", Scene(motion=_LATERAL, track_length=8), tuple(range(8, 31))
    ),
}

_PAPER = {
    "rotation": {"non": "1", "simple": "n", "general": "n/k²"},
    "position": {"non": "1", "simple": "n", "general": "n/k²"},
    "global_structure": {"non": "1/n", "simple": "n", "general": "n/k²"},
    "local_structure": {"non": "1/n", "simple": "1", "general": "1/b"},
}
_THEORY = {
    "rotation": {
        "non": "a constant: the noise of the first view stays",
        "simple": "∝ n exactly",
        "general": "∝ n, after a constant of the first L frames; slope 3/(L²−1) of L = 2",
    },
    "position": {
        "non": "a constant: the noise of the first view stays",
        "simple": "∝ n while the path is short against depth, then ∝ n³ (lever arm of rotation)",
        "general": "∝ n, then ∝ n³; slope 3/(L²−1) of L = 2",
    },
    "global_structure": {
        "non": "1/n, down to a floor: the first view alone ties the points to the world",
        "simple": "a constant floor (one view), then pose drift: n, then n³",
        "general": "a constant floor, then pose drift: n, then n³",
    },
    "local_structure": {
        "non": "1/n",
        "simple": "constant",
        "general": "constant in n; over b: (1/L)(H_b + (L−b)/b)",
    },
}


def rates(trials: int, seed: int, executor: Executor | None, progress: Progress | None = None) -> dict[str, Any]:
    """Measure Table 1; see the module.

    Keys: `table` (rows), `drift_over_span` and `structure_over_window` of the bound, `estimators_over_span` and
    `estimators_over_window`: variances of the estimators themselves.
    """
    table = []
    for name, run in RUNS.items():
        job = partial(measure, scene=run.scene, methods=READINGS, frames=run.frames)
        data = stacked(run_trials(job, trials, seed, executor, progress))
        kind = name.split("_")[0]  # non, simple or general
        for quantity in QUANTITIES:
            table.append(
                {
                    "sequence": name,
                    "title": run.title,
                    "quantity": quantity,
                    "frames": [run.frames[0], run.frames[-1]],
                    "paper": _PAPER[quantity][kind],
                    "measured_exponent": exponent(np.array(run.frames), data[METHOD.label][quantity]),
                    "exponents": {
                        m.label: exponent(np.array(run.frames), data[m.label][quantity]) for m in READINGS
                    },
                    "bound_exponent": exponent(np.array(run.frames), data["bound"][quantity]).value,
                    "theory": _THEORY[quantity][kind],
                }
            )
    few = bound_trials(trials)
    spans = run_trials(drift_rates, few, seed, executor, progress)
    windows = run_trials(structure_over_window, few, seed, executor, progress)
    return {
        "experiment": "rates",
        "trials": trials,
        "seed": seed,
        "estimator": METHOD.label,
        "table": table,
        "drift_over_span": _spans_report(np.stack(spans), few),
        "structure_over_window": _windows_report(np.stack(windows), few),
        "estimators_over_span": _estimators_over_span(trials, seed, executor, progress),
        "estimators_over_window": _estimators_over_window(trials, seed, executor, progress),
    }


def _estimators_over_span(
    trials: int, seed: int, executor: Executor | None, progress: Progress | None
) -> dict[str, Any]:
    """Variances of the estimators at the end of 31 frames by track length, over those at L = 2 (same image support)."""
    found: dict[str, dict[str, list[Interval]]] = {m.label: {q: [] for q in QUANTITIES} for m in READINGS}
    base: dict[str, dict[str, Array]] = {}
    for length in SPANS:
        scene = Scene(motion=_SLOW, track_length=length, support_frames=max(SPANS))
        job = partial(measure, scene=scene, methods=READINGS, frames=LAST_FRAMES, bound=False)
        data = stacked(run_trials(job, trials, seed, executor, progress))
        base = base or data
        for label, of_quantity in found.items():
            for quantity, values in of_quantity.items():
                values.append(ratio(data[label][quantity], base[label][quantity]))
    return {"span_frames": list(SPANS), "variance_relative": found}


def _estimators_over_window(
    trials: int, seed: int, executor: Executor | None, progress: Progress | None
) -> dict[str, Any]:
    """Variances of the estimators over the bound by the frames b in the window, at L = 8 and 200 mm per frame."""
    methods = tuple(Method(m.name, b, f"{m.name} b={b}") for m in READINGS for b in BATCHES)
    scene = Scene(motion=_LATERAL, track_length=8)
    job = partial(measure, scene=scene, methods=methods, frames=LAST_FRAMES)
    data = stacked(run_trials(job, trials, seed, executor, progress))
    found = {
        m.label: {
            q: [ratio(data[f"{m.name} b={b}"][q], data[f"{m.name} b={b}"][f"bound_{q}"]) for b in BATCHES]
            for q in QUANTITIES
        }
        for m in READINGS
    }
    return {"window_frames": list(BATCHES), "variance_over_bound": found}


def bound_trials(trials: int) -> int:
    """Return the number of trials of the laws that are evaluated on the bound."""
    return max(2, round(_BOUND_FRACTION * trials))


def total_trials(trials: int) -> int:
    """Return how many trials `rates` runs altogether."""
    return (len(RUNS) + len(SPANS) + 1) * trials + 2 * bound_trials(trials)


def drift_rates(seed: np.random.SeedSequence) -> Array:
    """Return the growth per frame of the bound's variance, (len(SPANS), 2: rad², m²), one image support for all L."""
    rows = []
    for length in SPANS:
        s = Scene(
            frames=_DRIFT_FRAMES[1] + 1,
            motion=_SLOW,
            track_length=length,
            support_frames=max(SPANS),
        ).sequence(seed)
        bound = cramer_rao_bound(s.projection, s.observations, s.world_from_cam, s.points_in_world)
        early = cramer_rao_bound(
            s.projection, s.observations, s.world_from_cam, s.points_in_world, _DRIFT_FRAMES[0]
        )
        grown = bound.cov_poses[-1] - early.cov_poses[-1]
        rows.append([np.trace(grown[3:, 3:]), np.trace(grown[:3, :3])])
    return np.array(rows) / (_DRIFT_FRAMES[1] - _DRIFT_FRAMES[0])


def structure_over_window(seed: np.random.SeedSequence) -> Array:
    """Return the mean variance of local structure from the last b frames alone, (len(WINDOWS),) m², at L = 16."""
    length = max(SPANS)
    s = Scene(frames=2 * length, motion=_SLOW, track_length=length).sequence(seed)
    values = []
    for b in WINDOWS:
        bound = cramer_rao_bound(s.projection, s.observations[-b:], s.world_from_cam[-b:], s.points_in_world)
        values.append(bound.cov_points_in_cam.trace(axis1=1, axis2=2).mean())
    return np.array(values)


def structure_law(length: int, window: int) -> float:
    """Return (1/L)(H_b + (L − b)/b): the variance of a point seen `length` times, in units of that of one view."""
    harmonic = sum(1 / k for k in range(1, window + 1))
    return (harmonic + (length - window) / window) / length


def _spans_report(values: Array, trials: int) -> dict[str, Any]:
    average = values.mean(axis=0)
    return {
        "trials": trials,
        "span_frames": list(SPANS),
        "rotation_relative": (average[:, 0] / average[0, 0]).tolist(),
        "position_relative": (average[:, 1] / average[0, 1]).tolist(),
        "theory": [3 / (length**2 - 1) for length in SPANS],
        "exponent_rotation": _slope(values[:, :, 0]),
        "exponent_theory": exponent(np.array(SPANS), np.array([[3 / (n**2 - 1) for n in SPANS]])).value,
    }


def _slope(values: Array) -> Interval:
    return exponent(np.array(SPANS), values)


def _windows_report(values: Array, trials: int) -> dict[str, Any]:
    relative = [mean((values[:, k] / values[:, 0])[:, None]) for k in range(len(WINDOWS))]
    return {
        "trials": trials,
        "window_frames": list(WINDOWS),
        "relative": relative,
        "theory": [structure_law(max(SPANS), b) for b in WINDOWS],
    }
