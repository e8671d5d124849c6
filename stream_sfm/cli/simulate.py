"""`stream-sfm simulate`: the paper's simulation, its Table 1 and Figure 6, and the consistency of every estimator."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import ExitCode
from . import arguments

EXPERIMENTS = {
    "efficiency": "variance of each estimator relative to the Cramér–Rao bound",
    "consistency": "whether the estimated covariances match the errors",
    "rates": "the paper's Table 1: growth of the error variance",
    "figure6": "the paper's Figure 6: errors over the sequence",
}


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser = arguments.add_command(
        subparsers,
        "simulate",
        run,
        summary="run Monte Carlo studies on the paper's simulated stereo pair",
        description="Run a Monte Carlo study on the paper's simulated stereo pair. Writes results.json and figures "
        "(PNG, SVG).",
        usage="EXPERIMENT [options]",
    )
    explained = "; ".join(f"{name}: {text}" for name, text in EXPERIMENTS.items())
    parser.add_argument("experiment", metavar="EXPERIMENT", choices=tuple(EXPERIMENTS), help=explained)
    study = parser.add_argument_group("study")
    study.add_argument(
        "--trials", type=arguments.positive, default=100, metavar="N", help="number of random scenes (default: 100)"
    )
    study.add_argument(
        "--seed", type=int, default=0, metavar="N", help="random seed: the same seed, the same numbers (default: 0)"
    )
    study.add_argument("--out", type=Path, metavar="DIR", help="result folder (default: runs/simulate-EXPERIMENT)")
    arguments.add_workers(parser)
    arguments.add_general(parser, json="results.json", quiet=True)


def run(args: argparse.Namespace) -> int:
    """Run one experiment, write its results and figures, print them."""
    import msgspec

    from ..executors import cluster, processes
    from .printing import print_json
    from .progress import counter
    from .simulation_tables import print_tables

    study, total, draw = _experiment(args)
    folder: Path = args.out or Path("runs") / f"simulate-{args.experiment}"
    _make(folder)
    with (
        cluster(args.scheduler) if args.scheduler else processes(args.workers) as executor,
        counter(f"simulate {args.experiment}", "trials", total, args.quiet) as advance,
    ):
        report = msgspec.to_builtins(study(args.trials, args.seed, executor, advance))
    _write(report, draw, folder, args.experiment)
    if args.json:
        print_json(report)
    elif not args.quiet:
        print_tables(args.experiment, report)
        print(f"results.json, {args.experiment}.png and {args.experiment}.svg in {folder}")
    return ExitCode.DONE


def _experiment(
    args: argparse.Namespace,
) -> tuple[Callable[..., dict[str, Any]], int, Callable[[dict[str, Any]], Any]]:
    """The study, its number of trials in all, and how its results are drawn."""
    from ..simulation import figure6, figures, rates, studies

    if args.experiment == "efficiency":
        return studies.efficiency, studies.total_trials(args.trials), figures.efficiency
    if args.experiment == "consistency":
        return studies.consistency, studies.total_trials(args.trials), figures.consistency
    if args.experiment == "rates":
        return rates.rates, rates.total_trials(args.trials), figures.rates
    return figure6.figure6, args.trials, figures.figure6


def _make(folder: Path) -> None:
    from ..errors import OutputError

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot write to {folder}: {error.strerror}") from None


def _write(report: dict[str, Any], draw: Callable[[dict[str, Any]], Any], folder: Path, name: str) -> None:
    from ..errors import OutputError
    from ..files import json_bytes, write_whole
    from ..simulation import figures

    write_whole(folder / "results.json", json_bytes(report))
    try:
        figures.save(draw(report), folder, name)
    except OSError as error:
        raise OutputError(f"cannot write to {folder}: {error.strerror}") from None
