"""Measures the cost of the engine, beside two references in the same run.

    python tools/bench.py logs/room.mcap --repeat 5 --set window.frames=8
    python tools/bench.py --scaling logs/room.mcap         cost against points, window, image size

The *floor* is decoding a pair and one pyramid of each image; the *loop* is plain OpenCV, frame to frame (600 corners,
KLT 21×21 over 4 levels left to right and through time, forward and backward, PnP with RANSAC). Each measurement is a
process of its own, imports included, from byte code that was compiled before, as pip does; the three take turns, and
medians of their ratios are what holds on a noisy machine. Milliseconds are this machine's.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

from rich.console import Console
from rich.table import Table

JOBS = Path(__file__).with_name("bench_jobs.py")
SCALING = {
    "frontend.max_tracks": (50, 100, 200, 400),
    "window.frames": (2, 4, 8, 16),
    "scale": (0.5, 0.75, 1.0),
}


def job(name: str, log: Path | str = "-", *overrides: str) -> dict[str, Any]:
    """One measurement in a fresh process."""
    command = [sys.executable, str(JOBS), name, str(log), *overrides]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)} failed:\n{done.stderr}")
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def start_up_cpu_s(log: Path) -> float:
    """CPU of `stream-sfm replay` on two frames, children of this process."""

    def children_s() -> float:
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    with tempfile.TemporaryDirectory() as folder:
        before = children_s()
        replay = [sys.executable, "-m", "stream_sfm", "replay", str(log), "--max-frames", "2"]
        subprocess.run([*replay, "--out", folder, "-q"], check=True)
        return children_s() - before


def measure(log: Path, repeat: int, overrides: list[str]) -> dict[str, Any]:
    """Medians over `repeat` turns of replay, loop and floor, and the figures taken once."""
    turns = [{name: job(name, log, *overrides) for name in ("replay", "loop", "floor")} for _ in range(repeat)]
    replays = [t["replay"] for t in turns]

    def ratio(name: str) -> float:
        return median(t["replay"]["cpu_ms_per_frame"] / t[name]["cpu_ms_per_frame"] for t in turns)

    quickest = min(replays, key=lambda r: r["step_ms"]["p50"])  # stages of one run, the least disturbed
    return {
        "frames": replays[0]["frames"],
        "cpu_ms_per_frame": median(r["cpu_ms_per_frame"] for r in replays),
        "cpu_over_loop": ratio("loop"),
        "cpu_over_floor": ratio("floor"),
        "frames_per_s": median(r["frames_per_s"] for r in replays),
        "step_p95_over_p50": median(r["step_ms"]["p95"] / r["step_ms"]["p50"] for r in replays),
        "last_third_over_first": median(r["last_third_over_first"] for r in replays),
        "peak_rss_mib": max(r["peak_rss_mib"] for r in replays),
        "stages_ms": {"step": quickest["step_ms"], "decode (wait)": quickest["decode_wait_ms"]} | quickest["stages_ms"],
        "step_above_imports_mib": job("step", log, *overrides)["above_images_mib"],
        "calls_a_frame": job("calls", log, *overrides),
        "budget": job("budget", log, *overrides),
        "samples_ms": job("samples", log, *overrides),
        "start_up_cpu_s": start_up_cpu_s(log),
        "ground_truth": replays[0]["ground_truth"],
        "turns": turns,
    }


def scaling(log: Path) -> dict[str, dict[str, float]]:
    """CPU a frame against each of SCALING, the others at their defaults."""
    return {
        key: {
            str(v): job("scaled" if key == "scale" else "replay", log, f"{key}={v}")["cpu_ms_per_frame"] for v in values
        }
        for key, values in SCALING.items()
    }


def show(results: dict[str, Any]) -> None:
    """Tables for people."""
    console = Console(width=120)
    for log, r in results["logs"].items():
        table = Table(title=f"{log}, {r['frames']} frames", show_header=False)
        for key, value in r.items():
            if isinstance(value, float):
                table.add_row(key, f"{value:.3g}")
        for key, value in r["ground_truth"].items():
            if isinstance(value, int | float):
                table.add_row(key, f"{value:.4g}")
        counts = r["calls_a_frame"]
        for whose in ("core", "python"):
            table.add_row(f"calls of {whose} a frame", f"{counts[whose]['a_frame']:.0f}")
        table.add_row("files that a frame enters", f"{counts['files']['entered']:.0f}")
        table.add_row("files of a step", f"{counts['step']['entered']:.0f}")
        table.add_row("files of a step, not behind a door", f"{counts['step']['to_read']:.0f}")
        for language, ms in r["budget"]["ms"].items():
            table.add_row(f"{language}, CPU ms a step", f"{ms:.2f}")
        for what, ms in r["samples_ms"].items():
            table.add_row(f"CPU ms a step, {what}", f"{ms:.2f}")
        for what, count in r["budget"]["unknowns"].items():
            table.add_row(f"unknowns: {what}", f"{count:.0f}")
        for stage, times in r["stages_ms"].items():
            table.add_row(f"{stage}, ms p50 / p95", f"{times['p50']:.2f} / {times['p95']:.2f}")
        console.print(table)
    if "window" in results:
        times = results["window"]["solve_ms"]
        console.print(f"window solve with covariances, b = 8, 200 points: {times['p50']:.1f} ms p50")
    for log, found in results.get("scaling", {}).items():
        table = Table("setting", "value", "CPU ms a frame", title=f"{log}: cost against settings")
        for key, values in found.items():
            for value, cpu_ms in values.items():
                table.add_row(key, value, f"{cpu_ms:.1f}")
        console.print(table)


def main() -> None:
    """Parse, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--repeat", type=int, default=3, help="turns of replay, loop and floor (3)")
    parser.add_argument("--scaling", action="store_true", help="cost against points, window and image size instead")
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of tables")
    a = parser.parse_args()
    with tempfile.TemporaryDirectory() as byte_code:
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        os.environ["PYTHONPYCACHEPREFIX"] = byte_code
        start_up_cpu_s(a.logs[0])  # compiles everything
        if a.scaling:
            results: dict[str, Any] = {"logs": {}, "scaling": {log.stem: scaling(log) for log in a.logs}}
        else:
            logs = {log.stem: measure(log, a.repeat, a.overrides) for log in a.logs}
            results = {"logs": logs, "window": job("window", "-", *a.overrides)}
    if a.json:
        print(json.dumps(results, indent=1))
    else:
        show(results)


if __name__ == "__main__":
    main()
