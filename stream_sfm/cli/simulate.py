"""`stream-sfm simulate`: the paper's simulation, its Table 1 and Figure 6, and the consistency of every estimator."""

import os
from pathlib import Path
from typing import Annotated, Literal

from ..errors import ExitCode
from ..system.wording import printable
from . import options
from .printing import print_json, print_notes, print_table
from .tables import Parameter

Experiment = Literal["efficiency", "consistency", "calibration", "rates", "figure6"]


def simulate(
    experiment: Experiment,
    /,
    *,
    out: options.MaybeFolder = None,
    trials: options.Count = 100,
    seed: Annotated[int, Parameter(metavar="N")] = 0,
    workers: options.Workers = None,
    latex: options.ResultFlag = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Run Monte Carlo studies on the paper's simulated stereo pair.

    Efficiency: variance of each estimator relative to the Cramér–Rao bound. Consistency: whether the estimated
    covariances match the errors. Calibration: estimates with a wrong calibration and errors that last along tracks.
    Rates: the paper's Table 1, growth of the error variance. Figure6: the paper's Figure 6, errors over the sequence.
    Writes results.json, results.csv and report.html, and for figure6 the picture (PNG, SVG). Needs the
    extra study.

    Args:
        experiment: the study
        out: result folder; runs/simulate-EXPERIMENT if not given
        trials: number of random scenes (100)
        seed: random seed; the same seed gives the same numbers (0)
        latex: also write the tables in LaTeX (results.tex)
    """
    from ..report.study import render_study
    from ..simulation import experiments
    from ..simulation.tables import tables, text_of, to_latex
    from ..system.files import write_whole
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
    write_whole(folder / "report.html", render_study(report).encode())
    if latex:
        write_whole(folder / "results.tex", to_latex(report).encode())
    if json:
        print_json(report)
    elif not quiet:
        for table in (table for table in tables(report) if not table.whole):
            rows = [[*names, *map(text_of, values)] for names, values in table.rows]
            # columns of the table: it has up to six
            headings = [*table.names, *table.columns]
            print_table(rows, headings, title=table.title, width=160, text_columns=len(table.names))
        written = "results.json, results.csv, report.html" + (", results.tex" if latex else "")
        written += ", figure6.png and figure6.svg" if experiment == "figure6" else ""
        print(f"{written} in {printable(str(folder))}")
    if report.get("interrupted"):
        if not quiet:
            print_notes("warning", [f"interrupted: {report['trials']} of {trials} trials are in the results"])
        return ExitCode.INTERRUPTED
    return ExitCode.DONE
