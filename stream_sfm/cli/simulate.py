"""`stream-sfm simulate`: the paper's simulation, its Table 1 and Figure 6, and the consistency of every estimator."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from ..wording import printable
from . import options
from .printing import interval, print_json, print_table

Experiment = Literal["efficiency", "consistency", "calibration", "rates", "figure6"]
_FRAMES = ("conditions", "estimators", "table")  # keys of reports that say nothing of what is below them


def simulate(
    experiment: Experiment,
    /,
    *,
    out: options.MaybeFolder = None,
    trials: options.Count = 100,
    seed: Annotated[int, Parameter(metavar="N")] = 0,
    workers: options.Workers = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Run Monte Carlo studies on the paper's simulated stereo pair.

    Efficiency: variance of each estimator relative to the Cramér–Rao bound. Consistency: whether the estimated
    covariances match the errors. Calibration: estimates with a wrong calibration and errors that last along tracks.
    Rates: the paper's Table 1, growth of the error variance. Figure6: the paper's Figure 6, errors over the sequence.
    Writes results.json, and for figure6 the picture (PNG, SVG).

    Args:
        experiment: the study
        out: result folder; runs/simulate-EXPERIMENT if not given
        trials: number of random scenes (100)
        seed: random seed; the same seed gives the same numbers (0)
    """
    from ..simulation import experiments
    from .progress import counter

    folder = Path(out) if out else Path("runs") / f"simulate-{experiment}"
    total = experiments.EXPERIMENTS[experiment].total_trials(trials)
    with counter(f"simulate {experiment}", "trials", total, quiet) as advance:
        report = experiments.simulate(
            experiment,
            folder,
            trials=trials,
            seed=seed,
            workers=workers or os.cpu_count() or 1,
            on_progress=advance,
        )
    if json:
        print_json(report)
    elif not quiet:
        parts = dict(_intervals(report))
        if parts and "expected" in report:
            parts["expected"] = {name: f"{value:g}" for name, value in report["expected"].items()}
        columns = list(dict.fromkeys(name for part in parts.values() for name in part))
        rows = [[name, *(part.get(column, "") for column in columns)] for name, part in parts.items()]
        if rows:
            title = f"{experiment}, {trials} trials: values and their 95 % intervals"
            # columns of the table: it has up to six
            print_table(rows, ["", *(c.replace("_", " ") for c in columns)], title=title, width=160)
        written = "results.json, figure6.png and figure6.svg" if experiment == "figure6" else "results.json"
        print(f"{written} in {printable(str(folder))}")


def _intervals(found: Any, *names: str) -> Iterator[tuple[str, dict[str, str]]]:
    """Of each part of a report its numbers with their 95 % intervals, by the names that lead to it."""
    if isinstance(found, dict):
        told = {k: interval(v["value"], v["low"], v["high"]) for k, v in found.items() if _is_interval(v)}
        if told:
            yield " ".join(names).replace("_", " "), told
        for name, part in found.items():
            if not _is_interval(part):
                yield from _intervals(part, *names, *([] if name in _FRAMES else [name]))


def _is_interval(found: Any) -> bool:
    return isinstance(found, dict) and {"value", "low", "high"} <= set(found)
