"""What each guarding rule is worth: every rule is switched off alone, and what gets worse on the logs is printed.

    python -m tools.ablation logs/room.mcap build/hard/*.mcap --only "wide templates" "pair check"

A rule stands in `RULES` by the name it is reached by in stream_sfm and by what takes its place. A cell holds the
aligned ATE in millimetres and, in brackets, how many frames are not ok; it is marked where one of the two is worse
than with all rules. A rule that no log needs should go, or a log that needs it is missing.
"""

import argparse
import importlib
import multiprocessing
import sys
from collections.abc import Iterable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent))
from accuracy import run

from stream_sfm.config import Config

AS_IS = "as it is"
WORSE = 1.1  # times the ATE: starting one frame later changes it by as much
RULES: dict[str, tuple[str, Any]] = {
    "wide templates": ("frontend.new_points:_BARE_FRACTION", 0.0),
    "slant": ("frontend.new_points:disparity_slopes", lambda left, right, points, *_: np.zeros((len(points), 2))),
    "halves of a patch agree": ("frontend.new_points:_MAX_HALVES_APART_PX", 1e9),
    "turn watch": ("frontend.right_turn:TurnWatch.judge", lambda self, *_: (self, None)),
    "exposure hypotheses": ("frontend.rough_motion:exposure_hypotheses", lambda before, now: [before.left_half]),
    "history weights": ("frontend.tracks:Tracks.weights", property(lambda self: np.ones(len(self)))),
    "second motion": ("geometry.resection:_with_second_motion", lambda views, found, weights: found),
    "one rigid body": ("frontend.tracker:rigid_motion", lambda views, weights, found, predicted: found),
    "hidden background": ("frontend.tracker:_is_background_hidden", lambda *_: False),
    "rejected tracks": ("frontend.tracker:_AMBIGUOUS", 0.0),
    "pair check": ("frontend.front_end:problem_of", lambda *_: ""),
    "global search": ("geometry.resection:_CALM_SHARE", -1.0),
}


def switched_off(rule: str) -> bool:
    """Take a rule out of the package in this process; whether it was there."""
    place, instead = RULES[rule]
    module, _, path = place.partition(":")
    *owners, name = path.split(".")
    try:
        owner = importlib.import_module(f"stream_sfm.{module}")
        for step in owners:
            owner = getattr(owner, step)
        getattr(owner, name)
    except (ImportError, AttributeError):
        return False
    setattr(owner, name, instead)
    return True


def measured(task: tuple[str, Path]) -> tuple[float, float] | None:
    """ATE in millimetres and frames that are not ok, without a rule; None where there is no such rule any more."""
    rule, path = task
    if rule != AS_IS and not switched_off(rule):
        return None
    figures = run(path, 0, Config())
    ate_m = figures["ate_rmse_aligned_m"]
    return (np.nan if ate_m is None else 1e3 * ate_m), figures["not_ok"] or 0.0


def cells(with_all: Iterable[Any], without: Iterable[Any]) -> Iterable[str]:
    """A cell per log, marked where it is worse than with all rules."""
    for known, found in zip(with_all, without, strict=True):
        if found is None:
            yield "no such rule"
        else:
            worse = found[0] > WORSE * known[0] or found[1] > known[1]
            yield f"{'[bold red]' if worse else ''}{found[0]:.3g} ({found[1]:.0f})"


def main() -> None:
    """Parse, replay each log with and without each rule, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path, help="logs with ground truth")
    parser.add_argument("--only", nargs="+", choices=RULES, metavar="RULE", help=f"some of {', '.join(RULES)}")
    parser.add_argument("--workers", type=int, default=2, help="replays at a time")
    arguments = parser.parse_args()
    rules = [AS_IS, *(arguments.only or RULES)]
    # a process for each replay: what it switches off is off nowhere else
    with multiprocessing.get_context("spawn").Pool(arguments.workers, maxtasksperchild=1) as pool:
        found = pool.map(measured, product(rules, arguments.logs), chunksize=1)
    rows = [found[k * len(arguments.logs) :][: len(arguments.logs)] for k in range(len(rules))]
    table = Table("without", *(path.stem for path in arguments.logs), title="ATE in mm (frames not ok)")
    for rule, row in zip(rules, rows, strict=True):
        table.add_row(rule, *cells(rows[0], row))
    Console(width=60 + 16 * len(arguments.logs)).print(table)


if __name__ == "__main__":
    main()
