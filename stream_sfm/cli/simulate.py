"""`stream-sfm simulate`: the paper's simulation, its Table 1 and Figure 6, and the consistency of every estimator."""

import argparse
from pathlib import Path
from typing import Any

from ..errors import ExitCode
from ..wording import printable
from . import arguments

EXPLAINED = {
    "efficiency": "variance of each estimator relative to the Cramér–Rao bound",
    "consistency": "whether the estimated covariances match the errors",
    "calibration": "estimates with a wrong calibration and errors that last along tracks",
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
    explained = "; ".join(f"{name}: {text}" for name, text in EXPLAINED.items())
    parser.add_argument("experiment", metavar="EXPERIMENT", choices=tuple(EXPLAINED), help=explained)
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
    from ..simulation.experiments import EXPERIMENTS, simulate
    from .printing import print_json
    from .progress import counter
    from .simulation_tables import print_tables

    folder: Path = args.out or Path("runs") / f"simulate-{args.experiment}"
    total = EXPERIMENTS[args.experiment].total_trials(args.trials)
    with counter(f"simulate {args.experiment}", "trials", total, args.quiet) as advance:
        report = simulate(
            args.experiment,
            folder,
            trials=args.trials,
            seed=args.seed,
            workers=args.workers,
            scheduler=args.scheduler,
            on_progress=advance,
        )
    if args.json:
        print_json(report)
    elif not args.quiet:
        print_tables(args.experiment, report)
        print(f"results.json, {args.experiment}.png and {args.experiment}.svg in {printable(str(folder))}")
    return ExitCode.DONE
