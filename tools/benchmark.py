"""Accuracy, consistency and cost on whole data sets or on clips, by the field's protocol, beside a baseline in git.

    python tools/benchmark.py clips logs ../logs --update-baseline --page      what docs/benchmarks.md is made by
    python tools/benchmark.py kitti DIR                     every sequence of KITTI odometry that is found there
    python tools/benchmark.py euroc DIR tumvi DIR --gate    exit code 1 where a figure is worse than the baseline allows

Poses are causal, as first issued, and aligned in SE(3), never in Sim(3). KITTI's t_rel and r_rel are over 100, 200 …
800 m. CPU time and p99 are this machine's: they are compared with a baseline that was made on an equal one only.
"""

import argparse
import json
import math
import os
import platform
import sys
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent))
from benchmark_page import write_page

from stream_sfm import FrameEstimate, StreamSfmError, __version__, open_log, read_config, replay
from stream_sfm.batch.logs import find_logs, names_for
from stream_sfm.evaluation.association import truth_of_frames
from stream_sfm.evaluation.relative import relative_errors
from stream_sfm.logs.sources.recognise import open_source
from stream_sfm.system.executors import processes
from stream_sfm.types import Frame

BASELINE = Path(__file__).with_name("benchmark_baseline.json")
SUITES = {
    "kitti": "KITTI odometry",
    "euroc": "EuRoC",
    "tumvi": "EuRoC",
    "clips": "",
}  # name -> format of its sources
_STANDS_M = 0.5  # a shorter true path has no errors per distance
Figures = dict[str, float | None]


@dataclass(frozen=True)
class Metric:
    """A figure: what is better, and by how much it may get worse, as a share of the baseline and in its own unit.

    `target`: the value that is best; None if less is better. `of_machine`: it depends on who computes it.
    """

    title: str
    unit: str
    share: float
    least: float
    target: float | None = None
    of_machine: bool = False

    def worse_by(self, value: float, baseline: float) -> float:
        """By how much a value is worse, negative where it is better; of a target, in its logarithm."""
        if self.target is None:
            return value - baseline
        return abs(math.log(value / self.target)) - abs(math.log(baseline / self.target))

    def allowed(self, baseline: float) -> float:
        """By how much it may be worse."""
        return max(self.least, self.share * abs(baseline) if self.target is None else self.share)


# Tolerances: what other corners of the same images change, which no work on the code is to blame for.
METRICS = {
    "t_rel_percent": Metric("t_rel", "%", 0.1, 0.02),
    "r_rel_deg_per_100m": Metric("r_rel", "°/100 m", 0.1, 0.02),
    "ate_rmse_aligned_m": Metric("ATE", "m", 0.15, 0.0005),
    "rpe_m": Metric("RPE", "m per frame", 0.1, 0.0001),
    "not_ok_percent": Metric("degraded", "% of frames", 0.1, 1.0),
    "lost_percent": Metric("lost", "% of frames", 0.0, 0.5),
    "nees_pose_mean": Metric("NEES", "6 expected", 0.4, 0.4, target=6.0),
    "factor_of_sigma": Metric("error / σ", "over one frame", 0.2, 0.2, target=1.0),
    "cpu_ms_per_frame": Metric("CPU", "ms per frame", 0.3, 2.0, of_machine=True),
    "p99_ms": Metric("p99", "ms", 0.5, 5.0, of_machine=True),
}


class _Times:
    """A sink that keeps how long each frame took."""

    def __init__(self) -> None:
        self.total_ms: list[float] = []

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        self.total_ms.append(sum(estimate.timings_ms.values()))

    def close(self) -> None:
        pass


def measure(path: Path, overrides: list[str], std_truth: tuple[float, float] | None = None) -> Figures | str:
    """The figures of one recording, or why there are none."""
    times = _Times()
    try:
        log = open_log(path)
        done = replay(log, None, read_config(None, overrides), std_truth=std_truth, sinks=[times])
    except StreamSfmError as error:
        return str(error)
    summary, truth = done.summary, log.ground_truth()
    frames, found = summary["frames"], summary.get("ground_truth") or {}
    count = frames["estimated"]
    figures: Figures = {name: found.get(name) for name in METRICS}
    if truth is not None and found:
        places = truth_of_frames(done.trajectory.stamps_ns, truth)
        apart, _ = relative_errors(done.trajectory.world_from_cam, places, 1)
        figures["rpe_m"] = float(np.sqrt(np.nanmean(apart**2)))
        spans = found.get("relative_consistency") or []
        figures["factor_of_sigma"] = spans[0]["factor"] if spans else None
        if np.nansum(np.linalg.norm(np.diff(places[:, :3, 3], axis=0), axis=1)) < _STANDS_M:
            figures |= {"t_rel_percent": None, "r_rel_deg_per_100m": None}
    return figures | {
        "frames": count,
        "path_m": summary["path_length_m"],
        "not_ok_percent": 100 * frames["degraded"] / count,
        "lost_percent": 100 * frames["lost"] / count,
        "cpu_ms_per_frame": 1e3 * summary["cpu_s"] / count,
        "p99_ms": float(np.percentile(times.total_ms, 99)),
    }


def found_in(suite: str, folders: list[str]) -> dict[str, Path]:
    """The recordings of a suite in folders, by suite and name."""
    names = names_for(find_logs(folders))
    form = SUITES[suite]
    return {f"{suite}/{name}": path for path, name in names.items() if not form or open_source(path).format == form}


def steps_back(results: dict[str, Figures], baseline: dict[str, Any], machine: str) -> list[str]:
    """What is worse than the baseline allows, in sentences; a sequence that the baseline has not is none."""
    said = []
    for name, old in baseline.get("sequences", {}).items():
        if name not in results:
            continue
        for key, metric in METRICS.items():
            before, now = old.get(key), results[name].get(key)
            if before is None or (metric.of_machine and baseline.get("machine") != machine):
                continue
            if now is None:
                said.append(f"{name}: {metric.title} is not known any more; it was {before:.4g}")
            elif (worse := metric.worse_by(now, before)) > metric.allowed(before):
                said.append(
                    f"{name}: {metric.title} went from {before:.4g} to {now:.4g} ({metric.unit}): worse by {worse:.3g}"
                )
    return said


def updated(baseline: dict[str, Any], results: dict[str, Figures], machine: str) -> dict[str, Any]:
    """The baseline with these results; the figures of another version become those of the last release."""
    release = baseline.get("release", {})
    if baseline and baseline["version"] != __version__:
        release = {"version": baseline["version"], "sequences": baseline["sequences"]}
    sequences = dict(sorted({**baseline.get("sequences", {}), **results}.items()))
    return {"version": __version__, "machine": machine, "sequences": sequences, "release": release}


def show(results: dict[str, Figures], baseline: dict[str, Any]) -> None:
    """Print one table, with the baseline beneath each figure that differs."""
    table = Table("sequence", "frames", *(f"{m.title}\n{m.unit}" for m in METRICS.values()))
    known = baseline.get("sequences", {})
    for name, figures in results.items():
        cells = []
        for key in METRICS:
            now, before = figures.get(key), known.get(name, {}).get(key)
            text = "–" if now is None else f"{now:.3g}"
            changed = before is not None and now is not None and abs(now - before) > 5e-3 * abs(before)
            cells.append(f"{text}\n({before:.3g})" if changed else text)
        table.add_row(name, str(figures["frames"]), *cells)
    Console(width=170).print(table)


def main() -> int:
    """Parse, replay, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="+", metavar="SUITE DIR…", help=f"{', '.join(SUITES)}, each with its folders")
    parser.add_argument("--gate", action="store_true", help="exit with 1 where something is worse than is allowed")
    parser.add_argument("--update-baseline", action="store_true", help="bless these figures")
    parser.add_argument("--page", action="store_true", help="write docs/benchmarks.md from the baseline")
    parser.add_argument("--baseline", type=Path, default=BASELINE, metavar="FILE")
    parser.add_argument("--workers", type=int, default=1, help="recordings at a time (1: cost is measured undisturbed)")
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument(
        "--ground-truth-std", type=float, nargs=2, metavar=("M", "RAD"), help="its σ; known for KITTI and EuRoC"
    )
    a = parser.parse_args()
    if a.what[0] not in SUITES:
        parser.error(f"begin with one of {', '.join(SUITES)}")
    folders: dict[str, list[str]] = {}
    for word in a.what:
        if word in SUITES:
            suite = word
            folders.setdefault(suite, [])
        else:
            folders[suite].append(word)
    recordings = {name: path for s, given in folders.items() for name, path in found_in(s, given).items()}
    baseline = json.loads(a.baseline.read_text()) if a.baseline.is_file() else {}
    machine = f"{platform.machine()}, {os.cpu_count()} cores"
    results: dict[str, Figures] = {}
    with processes(a.workers) as pool:
        measured = pool.map(measure, recordings.values(), repeat(a.overrides), repeat(a.ground_truth_std))
        for name, figures in zip(recordings, measured, strict=True):
            if isinstance(figures, str):
                print(f"{name}: {figures}", file=sys.stderr)
                figures = {"frames": 0}
                if name not in baseline.get("sequences", {}):
                    continue
            results[name] = figures
    show(results, baseline)
    worse = steps_back(results, baseline, machine)
    for sentence in worse:
        print(sentence, file=sys.stderr)
    if a.update_baseline:
        baseline = updated(baseline, results, machine)
        a.baseline.write_text(json.dumps(baseline, indent=1) + "\n")
    if a.page:
        write_page(baseline)
    return 1 if a.gate and worse else 0


if __name__ == "__main__":
    sys.exit(main())
