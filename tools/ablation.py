"""What each guarding rule is worth: every rule is switched off alone, and what gets worse on the logs is shown.

    python -m tools.ablation logs/room.mcap build/hard/*.mcap --frames 100 --only "wide templates" "pair check"

A rule stands in `RULES` by the name it is reached by in stream_sfm and by what takes its place. A cell of the table, in
Markdown, holds the aligned ATE in millimetres and, in brackets, how many frames are not ok; it is bold where one
of the two is worse than with all rules. A rule that neither a log nor a test needs should go.
"""

import argparse
import os
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any
from unittest.mock import patch

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from stream_sfm import Engine, Trajectory, open_log
from stream_sfm.config import Config
from stream_sfm.evaluation.summary import evaluate
from stream_sfm.frontend.ambiguity import AmbiguityMemory
from stream_sfm.frontend.depth_order import of_background
from stream_sfm.geometry.resection import resect
from stream_sfm.recording.stereo_log import StereoLog

WORSE = 1.1  # times the ATE: starting one frame later changes it by as much
RULES: dict[str, tuple[str, Any]] = {
    "wide templates": ("frontend.new_points._BARE_FRACTION", 0.0),
    "slant": ("frontend.new_points._STD_GREY", 1e9),
    "halves of a patch agree": ("frontend.new_points._MAX_HALVES_APART_PX", 1e9),
    "turn watch": ("frontend.right_turn.TurnWatch.judge", lambda self, *_: (self, None)),
    "today's exposure": ("frontend.rough_motion.as_exposed", lambda before, now: before.left_half),
    "further flow attempts": (
        "frontend.rough_motion._attempts",
        lambda levels, tracks, step: [(step.predicted, levels, 1.0)],
    ),
    "history weights": ("frontend.tracks.Tracks.weights", property(lambda self: np.ones(len(self)))),
    "second motion": ("geometry.resection.MIN_SECOND_VIEWS", 10**9),
    "one rigid body": (
        "frontend.tracker.resect",
        lambda views, start, weights, predicted: resect(views, start, weights),
    ),
    "ambiguity lasts": (
        "frontend.ambiguity.AmbiguityMemory.after",
        lambda self, motion, agreed, rival=None: (AmbiguityMemory(), motion.ambiguous or rival, False),
    ),
    "hidden background": ("frontend.tracker.is_background_hidden", lambda *_: False),
    "waiting for what returns": ("frontend.state.FrontEndState.may_wait", lambda *_: False),
    "least agreement": ("frontend.tracker._MIN_AGREEMENT", 0.0),
    "pair check": ("frontend.front_end.problem_of", lambda *_: ""),
    "repetition": ("frontend.tracker.OF_FLOW", (of_background,)),
    "global search": ("geometry.resection.CALM_SHARE", -1.0),
    "noise of bad frames": (
        "frontend.tracker.resect",
        lambda *a, **k: replace(resect(*a, **k), spread=1.0),
    ),
    "depths forget": ("frontend.tracks.FORGETTING", 1.0),
    "drift of templates": ("core.template_drift", lambda points, *_: np.zeros(len(points))),
}


def measured(log: StereoLog, frames: int) -> tuple[float, int]:
    """ATE of the first frames in millimetres, and how many after the first one are not ok."""
    engine, truth = Engine(log.rig, Config()), log.ground_truth()
    found = [engine.step(frame) for frame in islice(log.frames(), frames)]
    stamps, poses, covs = (
        np.array([getattr(e, name) for e in found]) for name in ("stamp_ns", "world_from_cam", "cov_pose")
    )
    ate_m = evaluate(Trajectory(stamps, poses, covs), truth)["ate_rmse_aligned_m"] if truth else None
    return 1e3 * ate_m if ate_m else np.nan, sum(e.status != "ok" for e in found[1:])


def column(path: Path, frames: int, rules: list[str]) -> list[str]:
    """The cells of a log: with all rules, then without each."""
    log, cells = open_log(path), []
    with_all = measured(log, frames)
    for rule in (None, *rules):
        ate_mm, not_ok = with_all
        if rule is not None:
            place, instead = RULES[rule]
            with patch(f"stream_sfm.{place}", instead):
                ate_mm, not_ok = measured(log, frames)
        cell = f"{ate_mm:.3g}" + (f" ({not_ok})" if not_ok else "")
        cells.append(f"**{cell}**" if ate_mm > WORSE * with_all[0] or not_ok > with_all[1] else cell)
    return cells


def main() -> None:
    """Parse, replay each log with and without each rule, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path, help="logs with ground truth")
    parser.add_argument("--frames", type=int, default=10**9, help="the first ones of each log")
    parser.add_argument("--only", nargs="+", choices=RULES, metavar="RULE", help=f"some of {', '.join(RULES)}")
    arguments = parser.parse_args()
    rules = arguments.only or list(RULES)
    columns = [column(path, arguments.frames, rules) for path in arguments.logs]
    print("| without |", " | ".join(path.stem for path in arguments.logs), "|")
    print("|---" * (1 + len(columns)) + "|")
    for rule, *cells in zip(["(as it is)", *rules], *columns, strict=True):
        print(f"| {rule} |", " | ".join(cells), "|")


if __name__ == "__main__":
    main()
