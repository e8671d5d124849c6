"""Runs worlds drawn at random, with and without their faults, beside the textbook loop; a line per world, and sums.

    python -m tools.worlds build/worlds --seeds 0 40 --even              # develop on even seeds,
    python -m tools.worlds build/worlds --seeds 0 200 --odd --workers 2  # report odd ones

Logs that are not in the folder yet are rendered into it, each with README.txt's line of what is wrong. Of each world:
frames by status; ok poses, and ok motions over one frame, that are wrong by more than 5 σ (Mahalanobis distance in six
dimensions); ATE after alignment, over that of the same scene without its faults; the loop's share of inliers and its
ATE (a body that fills the view has many inliers too, so that a loop that follows may still be wrong);
and terms of the rig that the run states with more than 5 σ though they were not drawn, or by much more than was drawn.
With --starts N each world also runs from N starting frames, and with strides of 2 and 3, as `tools/starts.py` does it.
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, fields
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from make_logs import WorldOrder, asked_faults, write_logs
from render.faults import Fault
from starts import BEYOND, Plan, Start, error_of, estimates_of, judged, runs_from, told
from starts import Run as JudgedRun
from textbook import FEW_DEGRADED, FOLLOWED, follow, verdict

from stream_sfm import open_log, read_config
from stream_sfm.camera.refinement import LENS_TERMS
from stream_sfm.config import Config
from stream_sfm.evaluation import trajectory
from stream_sfm.evaluation.association import truth_of_frames
from stream_sfm.logs.recording.stereo_log import StereoLog
from stream_sfm.rig_model.estimate import CERTAIN
from stream_sfm.rig_model.terms import AT_TURNING, DELAY, FOCAL, FOCUSING, READOUT, TERMS
from stream_sfm.types import FrameEstimate

TURNING, KNOCK, DISPARITY = "turning", "knock", "disparity"
# Terms that a fault makes, beside those whose size it is; what it moves is not judged by size.
MAKES = {
    "focal": (DISPARITY,),
    "zoom": (FOCAL, FOCUSING, DISPARITY),
    "breathing": (FOCAL, FOCUSING, DISPARITY),
    "knock": (KNOCK, DISPARITY),
    "slow_turn": (TURNING, KNOCK, DISPARITY),
}
# The loop is right where its ATE is within this share of the true path, and this much more: it drifts by a per cent or
# two where nothing is amiss, and by some millimetres in a camera at rest.
LOOP_RIGHT, LOOP_RIGHT_M = 0.02, 0.01
_OFF = 0.2  # of a drawn size: a stated one that errs by more, and by more than `BEYOND` σ, is wrong


@dataclass(frozen=True, slots=True)
class Stated:
    """A term of the rig that a run states with certainty; `drawn`: its true size, None if none is known."""

    term: str
    value: float
    std: float
    drawn: float | None
    there: bool

    @property
    def wrong(self) -> bool:
        """Whether it is not there, or far from what was drawn."""
        if not self.there or self.drawn is None:
            return not self.there
        off = abs(self.value - self.drawn)
        return off > BEYOND * self.std and off > _OFF * abs(self.drawn)

    def __str__(self) -> str:
        truth = "not there" if not self.there else "" if self.drawn is None else f"drawn {self.drawn:.3g}"
        return f"{self.term} {self.value:.3g} ± {self.std:.1g} ({truth})"


@dataclass(frozen=True, slots=True)
class Run(JudgedRun):
    """A replay of a world, and the terms of the rig that it states."""

    stated: list[Stated]

    @property
    def ate_m(self) -> float:
        """A world has the truth of all frames."""
        assert self.error_m is not None
        return self.error_m


@dataclass(frozen=True, slots=True)
class Outcome:
    """A world, its run, that of the same scene without faults (None: it has none), and the loop's inliers and ATE.

    `path_m`: the length of the true path. `starts`: runs from other starting frames, if they were asked for.
    """

    seed: int
    scene: str
    faults: list[str]
    faults_told: str
    run: Run
    clean: Run | None
    median_inliers: float
    loop_ate_m: float
    path_m: float
    starts: list[Start]

    @property
    def loop_is_right(self) -> bool:
        """Whether the loop follows the world, and the camera rather than a body."""
        off_m = LOOP_RIGHT * self.path_m + LOOP_RIGHT_M
        return self.median_inliers > FOLLOWED and self.loop_ate_m <= off_m

    @property
    def ratio(self) -> float | None:
        """ATE over that without faults."""
        return None if self.clean is None or not self.clean.ate_m else self.run.ate_m / self.clean.ate_m

    @property
    def verdict(self) -> str:
        """What the loop says of the run."""
        return verdict(self.median_inliers, self.run.frames, self.run.degraded + self.run.lost)

    def __str__(self) -> str:
        run, ratio = self.run, "" if self.ratio is None else f", {self.ratio:.2f} ×"
        wrong = [f"states {s}" for s in run.stated if s.wrong]
        if self.clean is not None:
            wrong += [f"states without faults {s}" for s in self.clean.stated if s.wrong]
        parts = (
            f"{self.seed:4d} {self.scene}; faults: {self.faults_told}",
            f"ok {run.ok}, degraded {run.degraded}, lost {run.lost}",
            f"beyond 5 σ {run.beyond_poses}, {run.beyond_motions}",
            f"ATE {1e3 * run.ate_m:.3g} mm{ratio}",
            f"loop {self.median_inliers:.2f}, {1e3 * self.loop_ate_m:.3g} mm of {self.path_m:.3g} m"
            + (", right" if self.loop_is_right else ""),
            *wrong,
            *run.problems,
            *filter(None, [self.verdict]),
        )
        return "\n     ".join([" | ".join(parts), *map(str, self.starts)])


def run_log(path: Path, config: Config, faults: dict[str, Fault]) -> Run:
    """Replay a log and judge it by its ground truth, and by what was drawn."""
    log = open_log(path)
    estimates, problems = estimates_of(log, config)
    run = judged(estimates, problems, _true(log, [e.stamp_ns for e in estimates]))
    return Run(*(getattr(run, f.name) for f in fields(run)), stated(estimates, faults))


def stated(estimates: Sequence[FrameEstimate], faults: dict[str, Fault]) -> list[Stated]:
    """What a run says of its rig in the end, with the size that was drawn of each."""
    rig = next((e.rig for e in reversed(estimates) if e.rig is not None), None)
    found = [(KNOCK, float(e.frame_index), 0.0) for e in estimates if e.rig_change is not None]
    if rig is not None:
        found += [(term, *rig.term(term)) for term in (DELAY, READOUT, FOCAL, FOCUSING) if rig.agrees((term,))]
        rate, cov = rig.mean[AT_TURNING], rig.cov[AT_TURNING, AT_TURNING]
        size = float(np.linalg.norm(rate))
        sigmas = float(np.sqrt(rate @ np.linalg.solve(cov, rate)))
        if rig.agrees(TERMS[AT_TURNING]):
            found.append((TURNING, size, size / max(sigmas, 1e-12)))
        if rig.applied and rig.agrees(LENS_TERMS):
            error, std = rig.mean[: len(LENS_TERMS)], np.sqrt(np.diag(rig.cov)[: len(LENS_TERMS)])
            most = int(np.argmax(np.abs(error) / std))
            found.append((DISPARITY, float(error[most]), float(std[most])))
    sizes = drawn_sizes(faults)
    return [
        Stated(term, value, std, sizes.get(term), term in sizes)
        for term, value, std in found
        if abs(value) > CERTAIN * std
    ]


def drawn_sizes(faults: dict[str, Fault]) -> dict[str, float | None]:
    """The terms that faults make: their sizes in units of the rig's terms, None if a size cannot be told."""
    sizes: dict[str, float | None] = {}
    for name, fault in faults.items():
        if fault.right_late_s:
            sizes[DELAY] = fault.right_late_s
        if fault.readout_s:
            sizes[READOUT] = fault.readout_s
        if fault.calibrated_focal != 1:
            sizes.setdefault(FOCAL, 1 / fault.calibrated_focal - 1)
        sizes |= dict.fromkeys(MAKES.get(name, ()))
    return sizes


def measure(folder: Path, config: Config, asked: Any, plan: Plan | None, seed: int) -> Outcome:
    """Render what is missing of a world, and run it; from other starts, too, if there is a plan of them."""
    cv2.setNumThreads(1)
    order, clean = WorldOrder(seed, asked), WorldOrder(seed, ())
    orders = [order, clean] if order.world.faults else [order]
    missing = [o for o in orders if not (folder / f"{o.stem}.mcap").exists()]
    if missing:
        write_logs(folder, missing, workers=1)
    path, *paths_clean = (folder / f"{o.stem}.mcap" for o in orders)
    log = open_log(path)
    loop = follow(log)
    true_of_loop = _true(log, loop.stamps_ns)
    return Outcome(
        seed,
        order.world.scene_truth,
        list(order.world.faults),
        order.world.faults_told,
        run_log(path, config, order.world.faults),
        run_log(paths_clean[0], config, {}) if paths_clean else None,
        loop.median_inliers,
        error_of(loop.world_from_cam, true_of_loop) or 0.0,
        trajectory.path_length_m(true_of_loop),
        [] if plan is None else list(runs_from(log, config, plan, loop)),
    )


def _true(log: StereoLog, stamps_ns: Sequence[int]) -> np.ndarray:
    """The truth (n, 4, 4) of frames."""
    truth = log.ground_truth()
    assert truth is not None  # of every world
    return truth_of_frames(np.asarray(stamps_ns), truth)


def summary(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Sums over worlds, as in the requirements: shares of frames, ratios, and terms that are not there."""
    runs = [o.run for o in outcomes]
    all_runs = [*runs, *(o.clean for o in outcomes if o.clean is not None)]
    followed = [o for o in outcomes if o.median_inliers > FOLLOWED]
    right = [o for o in outcomes if o.loop_is_right]
    ratios = [o.ratio for o in outcomes if o.ratio is not None]
    of_one = [o.ratio for o in outcomes if o.ratio is not None and len(o.faults) == 1]
    ok, frames = sum(r.ok for r in runs), sum(r.frames for r in runs)
    wrong = [s for r in all_runs for s in r.stated if s.wrong]
    return {
        "worlds": len(outcomes),
        "frames": frames,
        "ok": ok,
        "degraded": sum(r.degraded for r in runs),
        "lost": sum(r.lost for r in runs),
        "beyond_poses": sum(r.beyond_poses for r in runs),
        "beyond_motions": sum(r.beyond_motions for r in runs),
        "beyond_share": sum(r.beyond_poses for r in runs) / max(ok, 1),
        "beyond_poses_without_faults": sum(o.clean.beyond_poses for o in outcomes if o.clean is not None),
        "followed": len(followed),
        "followed_degraded_or_lost_share": _share_bad(followed),
        "followed_above_limit": sum(bool(o.verdict) for o in followed),
        "loop_right": len(right),
        "loop_right_degraded_or_lost_share": _share_bad(right),
        "loop_right_above_limit": sum(bool(o.verdict) for o in right),
        "ratio_median": _median(ratios),
        "ratio_median_one_fault": _median(of_one),
        "ratio_max_one_fault": max(of_one, default=None),
        "stated_not_there": sum(not s.there for s in wrong),
        "stated_wrong_size": sum(s.there for s in wrong),
        "worse_than_loop": sum(o.run.ate_m > o.loop_ate_m for o in outcomes),
        "with_problems": sum(bool(r.problems) for r in all_runs),
        "starts": told([start for o in outcomes for start in o.starts]) if any(o.starts for o in outcomes) else None,
    }


def _share_bad(outcomes: Sequence[Outcome]) -> float:
    """The share of frames that are degraded or lost."""
    bad = sum(o.run.degraded + o.run.lost for o in outcomes)
    return bad / max(sum(o.run.frames for o in outcomes), 1)


def _median(values: list[float]) -> float | None:
    return float(np.median(values)) if values else None


def _told(s: dict[str, Any]) -> str:
    def number(x: float | None) -> str:
        return "–" if x is None else f"{x:.2f}"

    lines = (
        f"{s['worlds']} worlds, {s['frames']} frames: ok {s['ok']}, degraded {s['degraded']}, lost {s['lost']}",
        f"ok beyond 5 σ: {s['beyond_poses']} poses ({s['beyond_share']:.2%}), {s['beyond_motions']} motions; "
        f"{s['beyond_poses_without_faults']} poses of the same scenes without faults",
        f"followed by the loop (inliers above {FOLLOWED:.0%}): {s['followed']} worlds; of their frames "
        f"{s['followed_degraded_or_lost_share']:.1%} are degraded or lost, and {s['followed_above_limit']} of the "
        f"worlds have more than {FEW_DEGRADED:.0%}",
        f"where the loop is right, too: {s['loop_right']} worlds; of their frames "
        f"{s['loop_right_degraded_or_lost_share']:.1%} are degraded or lost, and {s['loop_right_above_limit']} of the "
        f"worlds have more than {FEW_DEGRADED:.0%}",
        f"ATE over that without faults: median {number(s['ratio_median'])}; of one fault median "
        f"{number(s['ratio_median_one_fault'])}, largest {number(s['ratio_max_one_fault'])}; larger than the "
        f"loop's in {s['worse_than_loop']} worlds",
        f"terms stated with more than 5 σ: {s['stated_not_there']} are not there, {s['stated_wrong_size']} are far "
        f"from what was drawn; {s['with_problems']} runs say that they cannot be trusted",
    )
    return "\n".join([*lines, *([f"from other starts: {s['starts']}"] if s["starts"] else [])])


def main() -> None:
    """Parse, run, print a line per world as it is done, then the sums."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of the logs; those that are missing are rendered")
    parser.add_argument("--seeds", nargs=2, type=int, default=[0, 40], metavar=("FIRST", "END"), help="END is not one")
    parser.add_argument("--even", action="store_true", help="even seeds only")
    parser.add_argument("--odd", action="store_true", help="odd seeds only")
    parser.add_argument("--faults", nargs="+", metavar="NAME", help="as of make_logs")
    parser.add_argument("--starts", type=int, metavar="N", help="also run from N starting frames, and with strides")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of lines")
    arguments = parser.parse_args()
    parities = {0} if arguments.even else {1} if arguments.odd else {0, 1}
    seeds = [seed for seed in range(*arguments.seeds) if seed % 2 in parities]
    try:
        asked = asked_faults(arguments.faults)
    except ValueError as error:
        parser.error(str(error))
    plan = None if arguments.starts is None else Plan(arguments.starts)
    one = partial(measure, arguments.folder, read_config(None, arguments.overrides), asked, plan)
    outcomes = []
    with ProcessPoolExecutor(arguments.workers, mp_context=get_context("spawn")) as pool:
        for future in as_completed([pool.submit(one, seed) for seed in seeds]):
            outcomes.append(future.result())
            print(outcomes[-1], file=sys.stderr if arguments.json else sys.stdout, flush=True)
    outcomes.sort(key=lambda outcome: outcome.seed)
    sums = summary(outcomes)
    print(json.dumps({"summary": sums, "worlds": [_record(o) for o in outcomes]}) if arguments.json else _told(sums))


def _record(outcome: Outcome) -> dict[str, Any]:
    return {**asdict(outcome), "ratio": outcome.ratio, "verdict": outcome.verdict}


if __name__ == "__main__":
    main()
