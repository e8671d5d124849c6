"""Whether a change makes the window better: paired draws of 80 % of the tracks of several logs.

    python -m tools.thinned LOG... --out before.json                            # in one checkout
    python -m tools.thinned LOG... --out after.json --against before.json       # in the other one
    python -m tools.thinned LOG... --out after.json --against before.json --set window.most_followed=0

A single ATE decides nothing: between draws of its own tracks it scatters by a tenth on KITTI 06 and by three tenths on
a motorway. The front-end runs once per log, and the window on each draw, in which each track is kept with the same
chance in both runs. So differences of draws are paired. Given are the ratios of the errors over spans, and of the NEES,
with their standard errors over draws, for each log, and the mean of the logs with its standard error over logs.
Logs need ground truth; `LOG,rig.exact=true` gives one log a setting of its own.
"""

import argparse
import json
import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent))
from spans import POSES, SPANS, Source, measured, seen

from stream_sfm import read_config
from stream_sfm.methods import REFERENCE
from stream_sfm.run.self_test import part_of

KEPT = 0.8
Figures = dict[str, list[float]]  # by name: one value per draw


def kept(ids: np.ndarray, draw: int) -> np.ndarray:
    """Whether a draw keeps each track (n,): the same tracks whenever and wherever it is made; draw 0 keeps all."""
    if draw == 0:
        return np.ones(len(ids), bool)
    x = (ids.astype(np.uint64) << np.uint64(16)) + np.uint64(draw)
    for factor in (0xBF58476D1CE4E5B9, 0x94D049BB133111EB):  # splitmix64
        x = (x ^ (x >> np.uint64(30))) * np.uint64(factor)
    return np.asarray((x >> np.uint64(40)).astype(float) / 2**24 < KEPT)


def figures(log: str, draws: int, overrides: list[str]) -> Figures:
    """Return the figures of all draws of a log; `log`: a path, with settings of its own after commas."""
    path, *own = log.split(",")
    config = read_config(None, [*own, *overrides])
    whole, found = seen(Path(path), config), Figures()
    for draw in range(1, draws + 1):
        observations = [part_of(o, kept(o.track_ids, draw)) for o in whole.observations]
        of_draw = measured(Source(whole.projection, observations, whole.true), config, (REFERENCE,))
        values = {"NEES": of_draw.nees[REFERENCE]}
        for (name, span), both in of_draw.errors.items():
            if name == POSES:
                values |= {f"{kind} {span}": x for kind, x in zip(("position", "rotation"), both, strict=True)}
        for name, value in values.items():
            found.setdefault(name, []).append(value)
    return found


def compared(after: dict[str, Figures], before: dict[str, Figures]) -> Table:
    """Return the table of ratios: a row per log that both have, and their mean."""
    names = [f"{kind} {span}" for kind in ("position", "rotation") for span in SPANS] + ["NEES"]
    table = Table("log", *names, title="ratio ± its standard error")
    logs = [log for log in after if log in before]
    of_all: dict[str, list[float]] = {}
    for log in logs:
        cells = []
        for name in names:
            pairs = list(zip(after[log].get(name, []), before[log].get(name, []), strict=False))
            logarithms = np.log([a / b for a, b in pairs])
            cells.append(_cell(logarithms))
            if len(logarithms):
                of_all.setdefault(name, []).append(float(logarithms.mean()))
        table.add_row(Path(log.split(",")[0]).stem, *cells)
    if len(logs) > 1:
        table.add_row("mean of logs", *(_cell(np.array(of_all.get(name, []))) for name in names), style="bold")
    return table


def _cell(logarithms: np.ndarray) -> str:
    """Return a geometric mean with its relative standard error."""
    if not len(logarithms):
        return ""
    value = f"{np.exp(logarithms.mean()):.2f}"
    n = len(logarithms)
    return value if n < 2 else f"{value} ± {np.exp(logarithms.mean()) * logarithms.std(ddof=1) / np.sqrt(n):.2f}"


def main() -> None:
    """Parse, run, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", help="logs with ground truth; settings of one of them follow after commas")
    parser.add_argument("--draws", type=int, default=6)
    parser.add_argument("--out", type=Path, required=True, help="file for the figures of this run")
    parser.add_argument("--against", type=Path, help="file of another run, with which this one is compared")
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    arguments = parser.parse_args()
    found = {log: figures(log, arguments.draws, arguments.overrides) for log in arguments.logs}
    arguments.out.write_text(json.dumps(found, indent=1), encoding="utf-8")
    if arguments.against is not None:
        before = json.loads(arguments.against.read_text(encoding="utf-8"))
        Console(width=240).print(compared(found, before))


if __name__ == "__main__":
    main()
