"""`stream-sfm simulate`: the paper's simulation, its Table 1 and Figure 6, and the consistency of every estimator."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from ..wording import printable
from . import options
from .printing import interval, print_json, print_table

Experiment = Literal["efficiency", "consistency", "calibration", "rates", "figure6"]
_PIPED_WIDTH = 160  # columns: the table of rates has six, some of them sentences
Table = tuple[str, Sequence[str], Sequence[Sequence[str]]]  # title, headings, rows


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
        seed: random seed: the same seed, the same numbers (0)
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
        for title, headings, rows in _tables(report):
            words = 6 if "table" in report else 1
            print_table(rows, headings, title=title, width=_PIPED_WIDTH, text_columns=words)
        written = "results.json, figure6.png and figure6.svg" if experiment == "figure6" else "results.json"
        print(f"{written} in {printable(str(folder))}")


def _tables(report: dict[str, Any]) -> Iterator[Table]:
    """The main figures of a report, all of which are in results.json."""
    if "table" in report:
        yield _growth(report)
    elif "curves" in report:
        quantities = ("rotation", "position", "global_structure", "local_structure")
        rows = [
            [label, *(f"{1e3 * curves[q][-1]:.2f}" for q in quantities)]
            for label, curves in report["curves"].items()
        ]
        columns = ("rotation, mrad", "position, mm", "global structure, mm", "local structure, mm")
        yield (
            f"RMS errors at frame {report['frames'][-1]}, {report['trials']} trials",
            ["estimator", *columns],
            rows,
        )
    else:
        yield from _of_conditions(report)


def _growth(report: dict[str, Any]) -> Table:
    rows = [
        [
            row["title"],
            row["quantity"].replace("_", " "),
            f"{row['frames'][0]}–{row['frames'][1]}",
            row["paper"],
            *(f"n^ {_interval(found)}" for found in row["exponents"].values()),
            f"n^ {row['bound_exponent']:.2f}; {row['theory']}",
        ]
        for row in report["table"]
    ]
    estimators = [f"measured: {name}" for name in report["table"][0]["exponents"]]
    columns = ["sequence", "variance of", "frames", "paper", *estimators, "exact theory (exponent of the bound)"]
    return f"Table 1: growth of error variance, {report['trials']} trials", columns, rows


def _of_conditions(report: dict[str, Any]) -> Iterator[Table]:
    """Of each condition, a table for each kind of figures: one row per estimator, with its intervals."""
    expected = (f"{k.removeprefix('nees_')} {v:.0f}" for k, v in report.get("expected", {}).items() if "nees" in k)
    meanings = {
        "": f"mean normalised squared error (expected: {', '.join(expected).replace('_', ' ')})",
        "over_bound": "variance relative to the Cramér–Rao bound",
        "over_reference": f"variance relative to {report.get('reference')}, paired",
    }
    for condition, part in report["conditions"].items():
        for key, meaning in meanings.items():
            of_each = {name: found.get(key, {}) if key else found for name, found in part["estimators"].items()}
            cells = {
                name: {k: _interval(v) for k, v in entry.items() if isinstance(v, dict) and "low" in v}
                for name, entry in of_each.items()
            }
            columns = list(dict.fromkeys(k for entry in cells.values() for k in entry))
            rows = [[name, *(entry.get(k, "") for k in columns)] for name, entry in cells.items() if of_each[name]]
            if columns:
                title = f"{condition.replace('_', ' ')}: {meaning}; {part['trials']} trials"
                yield title, ["estimator", *(k.replace("_", " ") for k in columns)], rows


def _interval(found: dict[str, float]) -> str:
    return interval(found["value"], (found["low"], found["high"]))
