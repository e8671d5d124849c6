"""Runs a log from many starting frames, and with strides, beside the textbook loop; a line per run, and their sums.

    python -m tools.starts LOG...                       # from 10 frames, and every 2nd and 3rd frame from the first
    python -m tools.starts LOG --starts 20 --frames 60  # 60 frames from each of 20
    python -m tools.starts LOG --std-truth 0.01 0.002   # what the truth itself errs by, metres and radians

A start is the first frame of a run of its own: an estimate that depends on it shows luck. Of each run: frames that are
ok, degraded and lost; with ground truth, ok poses, and ok motions over one frame, that are wrong by more than 5 σ, the
ATE, and that of the loop on the same frames; without ground truth, the RMS distance from the loop's path.
"""

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from textbook import Loop, follow

from stream_sfm import StreamSfmError, open_log, read_config, replay
from stream_sfm.config import Config
from stream_sfm.evaluation import trajectory
from stream_sfm.evaluation.association import truth_of_frames
from stream_sfm.geometry import se3
from stream_sfm.geometry.linear import mahalanobis2
from stream_sfm.geometry.se3 import Array
from stream_sfm.logs.recording.stereo_log import StereoLog
from stream_sfm.motion import Motion
from stream_sfm.types import Frame, FrameEstimate, Selection, Status

BEYOND = 5.0  # σ
FEWEST = 20  # frames of a run: shorter ones tell little


@dataclass(frozen=True, slots=True)
class Run:
    """A run by its statuses, and by ground truth, or by another path where there is none.

    `beyond_poses` and `beyond_motions`: ok frames that are wrong by more than 5 σ; None without a truth. `error_m`:
    ATE, or the RMS distance from the other path, both after alignment; None if there is neither, or none of its frames.
    """

    frames: int
    ok: int
    degraded: int
    lost: int
    beyond_poses: int | None
    beyond_motions: int | None
    error_m: float | None
    problems: list[str]


@dataclass(frozen=True, slots=True)
class Start:
    """A run from frame `first` of a log with every `stride`-th frame, and the ATE of the loop, None without truth."""

    first: int
    stride: int
    run: Run
    loop_error_m: float | None

    @property
    def ratio(self) -> float | None:
        """ATE over that of the loop; None without ground truth."""
        return None if self.loop_error_m is None or self.run.error_m is None else self.run.error_m / self.loop_error_m

    def __str__(self) -> str:
        run, parts = self.run, [f"from {self.first:4d}" + f", every {self.stride}." * (self.stride > 1)]
        parts.append(f"ok {run.ok}, degraded {run.degraded}, lost {run.lost}")
        if run.beyond_poses is not None:
            parts.append(f"beyond 5 σ {run.beyond_poses}, {run.beyond_motions}")
        if run.error_m is not None:
            beside = "from the loop" if self.ratio is None else f"ATE, {self.ratio:.2f} × the loop's"
            parts.append(f"{1e3 * run.error_m:.3g} mm {beside}")
        return " | ".join([*parts, *run.problems])


@dataclass(frozen=True, slots=True)
class Plan:
    """Which runs: `starts` of them evenly over the log, one of each of `strides`, `frames` of each at most.

    `std_truth`: σ of the ground truth itself, metres and radians.
    """

    starts: int = 10
    strides: tuple[int, ...] = (2, 3)
    frames: int | None = None
    std_truth: tuple[float, float] = (0.0, 0.0)

    def selections(self, frames: int) -> Iterator[tuple[int, int]]:
        """Yield the first frame and the stride of each run of a log with this many frames."""
        free = max(frames - FEWEST, 0)
        for first in dict.fromkeys(k * free // max(self.starts, 1) for k in range(self.starts)):
            yield first, 1
        for stride in self.strides:
            yield 0, stride


class Kept:
    """A sink that keeps the estimates."""

    def __init__(self) -> None:
        self.estimates: list[FrameEstimate] = []

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        self.estimates.append(estimate)

    def close(self) -> None:
        pass


def estimates_of(
    log: StereoLog, config: Config, selection: Selection | None = None
) -> tuple[list[FrameEstimate], list[str]]:
    """Replay a log; return its estimates and problems. An error after the first frame is a problem."""
    kept = Kept()
    try:
        problems = replay(log, None, config, selection, sinks=[kept]).problems
    except StreamSfmError as error:
        if not kept.estimates:
            raise
        problems = [str(error)]
    return kept.estimates, problems


def judged(
    estimates: Sequence[FrameEstimate],
    problems: list[str],
    true: Array | None,
    std_truth: tuple[float, float] = (0.0, 0.0),
    other: Array | None = None,
) -> Run:
    """Judge the estimates of a run by the truth of its frames (n, 4, 4), NaN where unknown, or by an `other` path.

    Returns no counts of wrong frames without a truth of the first frame, as poses are relative to it.
    """
    statuses = [e.status for e in estimates]
    poses = np.array([e.world_from_cam for e in estimates])
    reference = other if true is None else true
    error_m = None if reference is None else error_of(poses, reference)
    beyond: tuple[int | None, int | None] = None, None
    if true is not None and np.isfinite(true[0]).all():
        beyond = _beyond(estimates, poses, true, std_truth)
    counts = (statuses.count(status) for status in (Status.OK, Status.DEGRADED, Status.LOST))
    return Run(len(estimates), *counts, *beyond, error_m, problems)


def error_of(poses: Array, reference: Array) -> float | None:
    """Return the RMS distance of positions after alignment, over the poses with a reference; None if fewer than 3."""
    known = np.isfinite(reference).all(axis=(1, 2))
    return trajectory.ate_rmse_aligned_m(poses[known], reference[known]) if known.sum() > 2 else None


def _beyond(
    estimates: Sequence[FrameEstimate], poses: Array, true: Array, std_truth: tuple[float, float]
) -> tuple[int, int]:
    """How many ok poses, and ok motions over one frame, are wrong by more than 5 σ, with that of the truth."""
    cov_truth = np.diag(np.repeat(np.square(std_truth), 3))
    known = np.isfinite(true).all(axis=(1, 2))
    now_from_first = se3.adjoint(se3.inverse(true[known]) @ true[0])
    covs = np.array([e.cov_pose for e in estimates])[known]
    covs = covs + cov_truth + now_from_first @ cov_truth @ np.swapaxes(now_from_first, 1, 2)
    wrong = trajectory.nees_pose(poses[known], covs, true[known]) > BEYOND**2
    ok = np.array([e.status == Status.OK for e in estimates])
    motions = sum(
        _motion_beyond(e, true[i - 1], true[i], 2 * cov_truth)
        for i, e in enumerate(estimates)
        if i and ok[i] and known[i - 1] and known[i]
    )
    return int((wrong & ok[known]).sum()), motions


def _motion_beyond(estimate: FrameEstimate, before: Array, now: Array, cov_truth: Array) -> bool:
    """Whether the motion since the frame before is wrong by more than 5 σ; False if there is none."""
    motion = Motion.of(estimate)
    if motion is None:
        return False
    error = se3.log(se3.inverse(motion.earlier_from_newest) @ se3.inverse(before) @ now)
    return bool(mahalanobis2(error[None], (motion.cov + cov_truth)[None])[0] > BEYOND**2)


def runs_from(log: StereoLog, config: Config, plan: Plan, loop: Loop | None = None) -> Iterator[Start]:
    """Run a log as planned. `loop`: what the textbook loop makes of all its frames, if that is known already."""
    loops = {1: follow(log) if loop is None else loop}
    stamps_ns = loops[1].stamps_ns
    truth = log.ground_truth()
    for first, stride in plan.selections(len(stamps_ns)):
        if stride not in loops:
            loops[stride] = follow(log, Selection(stride=stride))
        # between two stamps, as the selection has seconds
        start_s = float(stamps_ns[first - 1] + stamps_ns[first] - 2 * stamps_ns[0]) / 2e9 if first else None
        selection = Selection(start_s=start_s, max_frames=plan.frames, stride=stride)
        estimates, problems = estimates_of(log, config, selection)
        used_ns = np.array([e.stamp_ns for e in estimates])
        of_loop = _at(loops[stride], used_ns)
        true = None if truth is None else truth_of_frames(used_ns, truth)
        run = judged(estimates, problems, true, plan.std_truth, of_loop)
        yield Start(first, stride, run, None if true is None else error_of(of_loop, true))


def _at(loop: Loop, stamps_ns: np.ndarray) -> Array:
    """The loop's poses (n, 4, 4) of frames."""
    return loop.world_from_cam[np.searchsorted(loop.stamps_ns, stamps_ns)]


def told(starts: Sequence[Start]) -> str:
    """The sums over the runs of a log, in a line."""
    runs = [s.run for s in starts]
    parts = [f"{len(runs)} runs", f"{sum(r.lost > 0 for r in runs)} with lost frames"]
    parts.append(f"degraded or lost {sum(r.degraded + r.lost for r in runs)} of {sum(r.frames for r in runs)} frames")
    if any(r.beyond_poses is not None for r in runs):
        poses, motions = (sum(getattr(r, f"beyond_{of}") or 0 for r in runs) for of in ("poses", "motions"))
        parts.append(f"beyond 5 σ {poses} poses, {motions} motions")
    ratios = [s.ratio for s in starts if s.ratio is not None]
    if ratios:
        parts.append(f"ATE above the loop's in {sum(ratio > 1 for ratio in ratios)}")
    return ", ".join(parts)


def main() -> None:
    """Parse, run, print a line per run as it is done, then the sums of each log."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--starts", type=int, default=10, help="starting frames, evenly over each log")
    parser.add_argument("--strides", nargs="*", type=int, default=[2, 3], help="further runs from the first frame")
    parser.add_argument("--frames", type=int, help="of each run, at most; default: to the end of the log")
    parser.add_argument("--std-truth", nargs=2, type=float, default=[0.0, 0.0], metavar=("M", "RAD"),
                        help="σ of the ground truth itself")  # fmt: skip
    parser.add_argument("--calibration", type=Path, help="instead of the log's own")
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of lines")
    arguments = parser.parse_args()
    config = read_config(None, arguments.overrides)
    plan = Plan(arguments.starts, tuple(arguments.strides), arguments.frames, tuple(arguments.std_truth))
    found: dict[str, list[dict[str, Any]]] = {}
    for path in arguments.logs:
        starts = []
        for start in runs_from(open_log(path, calibration=arguments.calibration), config, plan):
            starts.append(start)
            print(f"{path.stem} {start}", file=sys.stderr if arguments.json else sys.stdout, flush=True)
        found[path.stem] = [asdict(start) | {"ratio": start.ratio} for start in starts]
        if not arguments.json:
            print(f"{path.stem}: {told(starts)}", flush=True)
    if arguments.json:
        print(json.dumps(found))


if __name__ == "__main__":
    main()
