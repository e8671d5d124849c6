"""Table 1 of the paper: how error variances grow with the frame number n, the span k of a track, the window b.

Each entry has the measured exponents, and that of the Cramér–Rao bound of the same trials; docs/accuracy.md adds
those of the paper. Simple: a point is seen in L = 2 frames; general: L = 8; non-transitory: in all. k = L/2.
"""

import numpy as np

from .figure6 import BATCHES
from .measure import QUANTITIES, Measured, Method, bound_of, bound_variances
from .scenes import MOTIONS, Scene
from .studies import Condition, Job, Report, Study, exponent, judged, mean, ratio, trials_of

# The joint window; the paper's WC and CC.
READINGS = tuple(map(Method, ("cross-frame", "cross-frame-wc", "cross-frame-cc")))
SPANS = (2, 4, 8, 16)  # L of the drift rates
WINDOWS = (1, 2, 4, 8, 16)  # b of the structure law, at L = 16
LAST_FRAMES = tuple(range(20, 31, 2))  # at which variances of the estimators are averaged
_DRIFT_FRAMES = (32, 96)  # drift is measured between them, at least twice the longest span from the start
_BOUND_FRACTION = 0.08  # of the trials, as the bound is costly and varies little between scenes


def _run(motion: str, length: int, frames: range) -> Condition:
    """Return a sequence of the table; exponents are fitted over `frames`."""
    scene = Scene(frames=frames[-1] + 1, motion=MOTIONS[motion], track_length=length)
    return judged(scene, tuple(frames), READINGS)


_SLOW, _LATERAL = MOTIONS["slow"], MOTIONS["lateral"]
RUNS = {
    "non_transitory_slow": _run("slow", 31, range(1, 31)),
    "simple_slow": _run("slow", 2, range(1, 31)),
    "simple_lateral": _run("lateral", 2, range(20, 81, 4)),
    "general_slow": _run("slow", 8, range(8, 31)),
    "general_lateral": _run("lateral", 8, range(8, 31)),
}


def _jobs() -> dict[str, Job]:
    jobs: dict[str, Job] = {**RUNS}
    for length in SPANS:  # one image support for all L
        scene = Scene(motion=_SLOW, track_length=length, support_frames=max(SPANS))
        jobs[f"L={length}"] = judged(scene, LAST_FRAMES, READINGS, bound=False)
    windows = [Method(m.name, b, f"{m.name} b={b}") for m in READINGS for b in BATCHES]
    jobs["windows"] = judged(Scene(motion=_LATERAL, track_length=8), LAST_FRAMES, windows)
    jobs["drift"] = Job(drift_rates, _BOUND_FRACTION)
    jobs["structure"] = Job(structure_over_window, _BOUND_FRACTION)
    return jobs


def _report(measured: dict[str, Measured]) -> Report:
    """Report Table 1, as the module says.

    Keys: `table` by run and quantity, `drift_over_span` and `structure_over_window` of the bound. Variances of the
    estimators themselves are in `estimators_over_span`, over those at L = 2 at the end of 31 frames, and in
    `estimators_over_window`, over the bound at L = 8 and 200 mm per frame.
    """
    by_length = [measured[f"L={length}"] for length in SPANS]
    over_span = {
        m.name: {q: [ratio(data[m.name][q], by_length[0][m.name][q]) for data in by_length] for q in QUANTITIES}
        for m in READINGS
    }
    by_window = {m.name: [measured["windows"][f"{m.name} b={b}"] for b in BATCHES] for m in READINGS}
    over_window = {
        name: {q: [ratio(entry[q], entry[f"bound_{q}"]) for entry in entries] for q in QUANTITIES}
        for name, entries in by_window.items()
    }
    return {
        "table": {f"{name} {q}": _row(run, q, measured[name]) for name, run in RUNS.items() for q in QUANTITIES},
        "drift_over_span": _drift_report(measured["drift"]),
        "structure_over_window": _structure_report(measured["structure"]),
        "estimators_over_span": {"span_frames": list(SPANS), "variance_relative": over_span},
        "estimators_over_window": {"window_frames": list(BATCHES), "variance_over_bound": over_window},
    }


def _row(run: Condition, quantity: str, data: Measured) -> Report:
    x = np.array(run.frames)
    return {
        "frames": [run.frames[0], run.frames[-1]],
        "exponents": {m.name: exponent(x, data[m.name][quantity]) for m in READINGS},
        "bound_exponent": exponent(x, data["bound"][quantity]).value,
    }


def drift_rates(seed: np.random.SeedSequence) -> Measured:
    """Return the growth per frame of the variances of the bound, (len(SPANS),) by track length, for one support."""
    grown = []
    for length in SPANS:
        last = _DRIFT_FRAMES[-1]
        scene = Scene(frames=last + 1, motion=_SLOW, track_length=length, support_frames=max(SPANS))
        sequence = scene.sequence(seed)
        variances = bound_variances([bound_of(sequence, n) for n in _DRIFT_FRAMES])
        grown.append({q: np.ptp(v) / np.ptp(_DRIFT_FRAMES) for q, v in variances.items()})
    return {"bound": {q: np.array([of_length[q] for of_length in grown]) for q in ("rotation", "position")}}


def structure_over_window(seed: np.random.SeedSequence) -> Measured:
    """Return the variance of local structure from the last b frames alone, (len(WINDOWS),) m², at L = 16."""
    length = max(SPANS)
    sequence = Scene(frames=2 * length, motion=_SLOW, track_length=length).sequence(seed)
    variances = bound_variances([bound_of(sequence, newest=b) for b in WINDOWS])
    return {"bound": {"local_structure": variances["local_structure"]}}


def structure_law(length: int, window: int) -> float:
    """Return (1/L)(H_b + (L − b)/b): the variance of a point seen `length` times, in units of that of one view."""
    harmonic = sum(1 / k for k in range(1, window + 1))
    return (harmonic + (length - window) / window) / length


def _drift_report(data: Measured) -> Report:
    rotation, position = (data["bound"][q].mean(axis=0) for q in ("rotation", "position"))
    theory = np.array([3 / (length**2 - 1) for length in SPANS])
    return {
        "trials": trials_of(data),
        "span_frames": list(SPANS),
        "rotation_relative": (rotation / rotation[0]).tolist(),
        "position_relative": (position / position[0]).tolist(),
        "theory": theory.tolist(),
        "exponent_rotation": exponent(np.array(SPANS), data["bound"]["rotation"]),
        "exponent_theory": exponent(np.array(SPANS), theory[None]).value,
    }


def _structure_report(data: Measured) -> Report:
    variances = data["bound"]["local_structure"]
    return {
        "trials": trials_of(data),
        "window_frames": list(WINDOWS),
        "relative": [mean(variances[:, [k]] / variances[:, [0]]) for k in range(len(WINDOWS))],
        "theory": [structure_law(max(SPANS), b) for b in WINDOWS],
    }


RATES = Study(_jobs, _report)
