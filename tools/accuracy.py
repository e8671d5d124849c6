"""Accuracy on a set of logs over several starting frames: medians, spreads, and the best peer where one is known.

    python tools/accuracy.py logs/room.mcap ../logs --offsets 0 1 2 3 --set window.frames=8

    python tools/accuracy.py --hard build/hard

One offset is one replay without this many leading frames: the same log with other corners, which shows how much a
figure varies. `--hard` takes the hard scenes of tools/render/hard.py, rendered into a folder unless they are
already there (an hour on two cores). Logs without ground truth are listed with the statuses of their frames only.
"""

import argparse
import json
import os
import sys
import tomllib
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent))
from make_logs import Order, write_logs
from render import RECORDINGS

from stream_sfm import Engine, Trajectory, open_log, read_config
from stream_sfm.config import Config
from stream_sfm.evaluation.summary import evaluate

FIGURES = ("t_rel_percent", "final_drift_percent", "ate_rmse_aligned_m", "nees_pose_mean")


def run(path: Path, offset: int, config: Config) -> dict[str, float | None]:
    """Figures of one replay from the frame `offset` on; `not_ok` counts frames after the first that are not ok."""
    log = open_log(path)
    engine = Engine(log.rig, config)
    estimates = []
    for index, frame in enumerate(log.frames()):
        if index >= offset:
            e = engine.step(frame)
            estimates.append((e.stamp_ns, e.world_from_cam, e.cov_pose, e.status))
    stamps, poses, covs, statuses = (list(column) for column in zip(*estimates, strict=True))
    truth = log.ground_truth()
    found = evaluate(Trajectory(np.array(stamps), np.array(poses), np.array(covs)), truth) if truth else {}
    return {name: found.get(name) for name in FIGURES} | {"not_ok": float(sum(s != "ok" for s in statuses[1:]))}


def median_and_spread(values: list[float | None]) -> str:
    """Median [smallest, largest]."""
    known = [v for v in values if v is not None]
    return f"{np.median(known):.4g} [{min(known):.4g}, {max(known):.4g}]" if known else "–"


def rendered(folder: Path) -> list[Path]:
    """The hard scenes in a folder; those that are missing are rendered."""
    paths = [folder / f"{name}.mcap" for name in RECORDINGS]
    write_logs(folder, [Order(path.stem) for path in paths if not path.exists()], workers=2)
    return paths


def main() -> None:
    """Parse, replay, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path, help="MCAP files, or folders of them")
    parser.add_argument("--hard", type=Path, metavar="DIR", help="the hard scenes too, rendered into this folder")
    parser.add_argument("--offsets", nargs="+", type=int, default=[0, 1, 2, 3], help="leading frames left out")
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    config = read_config(None, arguments.overrides)
    peers = tomllib.loads(Path(__file__).with_name("peers.toml").read_text(encoding="utf-8"))
    if arguments.hard is not None:
        arguments.logs += rendered(arguments.hard)
    if not arguments.logs:
        parser.error("name logs, or --hard DIR")
    paths = [p for given in arguments.logs for p in (sorted(given.glob("*.mcap")) if given.is_dir() else [given])]
    results = {path.stem: [run(path, offset, config) for offset in arguments.offsets] for path in paths}
    if arguments.json:
        print(json.dumps(results))
        return
    table = Table("log", *FIGURES, "frames not ok", title=f"median [range] over offsets {arguments.offsets}")
    for name, runs in results.items():
        table.add_row(name, *(median_and_spread([r[f] for r in runs]) for f in (*FIGURES, "not_ok")))
        best = [min(known, key=known.get) if (known := peers.get(name, {}).get(f)) else None for f in FIGURES]
        if any(best):
            cells = [f"{peers[name][f][b]:.4g} {b}" if b else "" for f, b in zip(FIGURES, best, strict=True)]
            table.add_row("  best peer", *cells, "", style="dim")
    Console(width=150).print(table)


if __name__ == "__main__":
    main()
