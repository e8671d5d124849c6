"""Shows what each guarding rule is worth: switches off every rule alone, and shows what gets worse on logs.

    python -m tools.ablation logs/room.mcap build/hard/*.mcap --frames 100 --only "wide templates" "pair check"

`RULES` has each rule with the settings that switch it off. A cell of the Markdown table has the aligned ATE in
millimetres and, in brackets, the number of frames that are not ok. It is bold if one of the two is worse than with
all rules, and = if poses and covariances are the same to the last bit. A rule that neither a log nor a test needs
should go.
"""

import argparse
import os
from itertools import islice
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from stream_sfm import Engine, Trajectory, open_log, read_config
from stream_sfm.evaluation.summary import evaluate
from stream_sfm.logs.recording.stereo_log import StereoLog

WORSE = 1.1  # times the ATE: starting one frame later changes it by as much
RULES: dict[str, tuple[str, ...]] = {  # the settings that switch it off
    "wide templates": ("rules.points.bare_fraction=0",),
    "slant": ("rules.points.std_grey=1e8",),
    "halves of a patch agree": ("rules.points.max_halves_apart_px=1e8",),
    "turn watch": ("rules.turn.knocks=1e-300",),
    "today's exposure": ("rules.flow.same_gain=1e8", "rules.flow.same_level_grey=1e8"),
    "further flow attempts": ("rules.flow.enough=0",),
    "history weights": ("rules.motion.first_vote=1e6",),
    "second motion": ("rules.robust.second_views=1000000",),
    "one rigid body": ("rules.motion.one_body=false",),
    "confirmed by new points": ("rules.motion.confirmed_nats=0.01",),
    "hidden background": ("rules.motion.hidden_views=1000000",),
    "waiting for what returns": ("rules.motion.max_gap_s=0",),
    "least agreement": ("rules.motion.min_agreement=0",),
    "pair check": (
        "rules.pair.fit=0",
        "rules.pair.max_rows_px=1e8",
        "rules.pair.max_scatter_px=1e8",
        "rules.pair.max_factor=1e8",
    ),
    "repetition": ("rules.repetition.reach=100000",),
    "global search": ("rules.robust.calm_share=0",),
    "noise of bad frames": ("rules.motion.poor_frames=false",),
    "depths forget": ("rules.motion.forgetting=1",),
    "drift of templates": ("rules.errors.slide=0",),
    "earlier images show through": ("rules.ghosts.share=1",),
    "left and right are one image": ("rules.images.fewest_slopes=1000000000",),
}


def measured(log: StereoLog, frames: int, overrides: tuple[str, ...] = ()) -> tuple[float, int, bytes]:
    """ATE of the first frames in millimetres, how many after the first one are not ok, and their poses as bytes."""
    engine, truth = Engine(log.rig, read_config(None, overrides)), log.ground_truth()
    found = [engine.step(frame) for frame in islice(log.frames(), frames)]
    stamps, poses, covs = (
        np.array([getattr(e, name) for e in found]) for name in ("stamp_ns", "world_from_cam", "cov_pose")
    )
    ate_m = evaluate(Trajectory(stamps, poses, covs), truth)["ate_rmse_aligned_m"] if truth else None
    not_ok = sum(e.status != "ok" for e in found[1:])
    return 1e3 * ate_m if ate_m else np.nan, not_ok, poses.tobytes() + covs.tobytes()


def column(path: Path, frames: int, rules: list[str]) -> list[str]:
    """The cells of a log: with all rules, then without each."""
    log, cells = open_log(path), []
    with_all = measured(log, frames)
    for rule in (None, *rules):
        ate_mm, not_ok, estimates = with_all if rule is None else measured(log, frames, RULES[rule])
        cell = f"{ate_mm:.3g}" + (f" ({not_ok})" if not_ok else "")
        worse = ate_mm > WORSE * with_all[0] or not_ok > with_all[1]
        same = rule is not None and (not_ok, estimates) == with_all[1:]
        cells.append("=" if same else f"**{cell}**" if worse else cell)
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
