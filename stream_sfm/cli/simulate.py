"""`stream-sfm simulate`: the paper's simulation, its Table 1 and Figure 6, and the honesty of every estimator."""

import argparse
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from . import arguments

EXPERIMENTS = ("efficiency", "consistency", "rates", "figure6")


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "simulate",
        help="Monte-Carlo studies on the paper's simulated stereo pair",
        description="efficiency: variance of each estimator over the Cramér–Rao bound. consistency: do the "
        "covariances tell the truth. rates: the paper's Table 1. figure6: the paper's Figure 6. Writes "
        "results.json and figures (PNG, SVG).",
    )
    parser.add_argument("experiment", choices=EXPERIMENTS)
    parser.add_argument(
        "--trials", type=arguments.positive, default=100, metavar="N", help="random scenes (default 100)"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="same seed, same numbers (default 0)")
    arguments.add_workers(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder (default runs/simulate-<experiment>)")
    parser.add_argument("--json", action="store_true", help="print the results as one JSON object, nothing else")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run one experiment, write its results and figures, print them."""
    import msgspec

    from ..errors import ExitCode, OutputError
    from ..executors import cluster, processes
    from ..files import json_bytes, write_whole
    from ..simulation import figure6, figures, rates, studies
    from . import output

    experiments: dict[str, tuple[Callable[..., dict[str, Any]], int, Callable[[dict[str, Any]], Any]]] = {
        "efficiency": (studies.efficiency, studies.total_trials(args.trials), figures.efficiency),
        "consistency": (studies.consistency, studies.total_trials(args.trials), figures.consistency),
        "rates": (rates.rates, rates.total_trials(args.trials), figures.rates),
        "figure6": (figure6.figure6, args.trials, figures.figure6),
    }
    study, total, draw = experiments[args.experiment]
    folder: Path = args.out or Path("runs") / f"simulate-{args.experiment}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot write to {folder}: {error.strerror}") from None
    with (
        cluster(args.scheduler) if args.scheduler else processes(args.workers) as executor,
        output.counter(f"simulate {args.experiment}", total) as advance,
    ):
        report = msgspec.to_builtins(study(args.trials, args.seed, executor, advance))
    try:
        write_whole(folder / "results.json", json_bytes(report))
        figures.save(draw(report), folder, args.experiment)
    except OSError as error:
        raise OutputError(f"cannot write to {folder}: {error.strerror}") from None
    if args.json:
        output.print_json(report)
    else:
        _print_report(args.experiment, report)
        print(f"results.json, {args.experiment}.png and .svg in {folder}")
    return ExitCode.DONE


def _print_report(experiment: str, report: dict[str, Any]) -> None:
    from rich.console import Console

    console = Console(width=None if sys.stdout.isatty() else 160)
    for table in _tables(experiment, report):
        console.print(table)


def _tables(experiment: str, report: dict[str, Any]) -> Iterator[Any]:
    if experiment == "rates":
        yield from _rates_tables(report)
    elif experiment == "figure6":
        names = ("rotation", "position", "global_structure", "local_structure")
        rows = [
            [label, f"{1e3 * c['rotation'][-1]:.2f}", *(f"{1e3 * c[q][-1]:.1f}" for q in names[1:])]
            for label, c in report["curves"].items()
        ]
        yield _table(
            f"RMS errors at frame {report['frames'][-1]}, {report['trials']} trials",
            ["estimator", "rotation, mrad", "position, mm", "global structure, mm", "local structure, mm"],
            rows,
        )
    else:
        for condition, part in report["conditions"].items():
            for key in ("over_bound", "over_reference") if experiment == "efficiency" else (None,):
                entries = {
                    name: e[key] if key else {k: v for k, v in e.items() if isinstance(v, dict)}
                    for name, e in part["estimators"].items()
                    if key is None or key in e
                }
                if entries:
                    title = {
                        "over_bound": "variance over the Cramér–Rao bound",
                        "over_reference": f"variance over that of {report['reference']}, paired",
                        None: "mean normalised squared error (pose 6, points 3 expected)",
                    }[key]
                    columns = list(next(iter(entries.values())))
                    rows = [[name, *(_interval(e[c]) for c in columns)] for name, e in entries.items()]
                    title = f"{condition}: {title}; {part['trials']} trials"
                    yield _table(title, ["estimator", *(c.replace("_", " ") for c in columns)], rows)


def _rates_tables(report: dict[str, Any]) -> Iterator[Any]:
    rows = [
        [
            row["title"],
            row["quantity"].replace("_", " "),
            f"{row['frames'][0]}–{row['frames'][1]}",
            row["paper"],
            "n^ " + _interval(row["measured_exponent"]),
            f"n^ {row['bound_exponent']:.2f}; {row['theory']}",
        ]
        for row in report["table"]
    ]
    columns = ["sequence", "variance of", "frames", "paper", "measured", "exact theory (exponent of the bound)"]
    yield _table(f"Table 1: growth of error variance, {report['trials']} trials", columns, rows)
    spans, windows = report["drift_over_span"], report["structure_over_window"]
    yield _table(
        f"Drift rate over track length, bound; exponent {_interval(spans['exponent_rotation'])}",
        ["L", "rotation", "position", "3/(L²−1)"],
        [
            [str(n), *(f"{v:.4f}" for v in values)]
            for n, *values in zip(
                spans["span_frames"],
                spans["rotation_relative"],
                spans["position_relative"],
                spans["theory"],
                strict=True,
            )
        ],
    )
    yield _table(
        "Local structure over the window, bound, L = 16",
        ["b", "variance over one view", "(1/L)(H_b + (L−b)/b)"],
        [
            [str(b), _interval(v), f"{t:.3f}"]
            for b, v, t in zip(windows["window_frames"], windows["relative"], windows["theory"], strict=True)
        ],
    )


def _table(title: str, columns: list[str], rows: list[list[str]]) -> Any:
    from rich.table import Table

    table = Table(*columns, title=title, title_justify="left")
    for row in rows:
        table.add_row(*row)
    return table


def _interval(v: dict[str, float]) -> str:
    return f"{v['value']:.2f} \\[{v['low']:.2f}, {v['high']:.2f}]"
