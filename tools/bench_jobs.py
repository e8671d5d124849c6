"""What tools/bench.py measures, one job a process, so that CPU time and peak memory are the job's own.

Each job imports what it needs and no more: the loop and the floor pay for reading a log, not for an engine.

python tools/bench_jobs.py replay|loop|floor|step|calls|budget|samples|scaled|window LOG [KEY=VALUE ...]  prints JSON
"""

import json
import os
import resource
import sys
import tempfile
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
if len(sys.argv) > 1 and sys.argv[1] in (
    "replay",
    "step",
    "budget",
    "samples",
    "scaled",
    "window",
):  # as the command line sets it
    from stream_sfm.cli.process import settle

    settle()

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from bench_counts import WARM_UP, AfterFrame, run_calls

LK = {"winSize": (21, 21), "maxLevel": 3}


def cpu_s() -> float:
    """CPU time of the whole process so far, all threads, imports included."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def memory_mib(field: str) -> float:
    """VmRSS or VmHWM of this process."""
    line = next(x for x in Path("/proc/self/status").read_text().splitlines() if x.startswith(field))
    return int(line.split()[1]) / 1024


def stages() -> dict[str, list[tuple[Any, str]]]:
    """Stage -> the functions whose time it is; what they call of other stages counts in both."""
    from stream_sfm.camera.rectification import Rectifier
    from stream_sfm.estimators.window import cross_frame
    from stream_sfm.estimators.window.state import WindowState
    from stream_sfm.frontend import front_end, new_points, rough_motion, tracker
    from stream_sfm.results.estimates_writer import EstimatesWriter

    return {
        "rectify": [(Rectifier, "rectify")],
        "track": [(rough_motion, "track"), (tracker, "align")],
        "PnP": [(tracker, "resect"), (cross_frame, "initial_motion")],
        "detect": [(new_points, "detect_missing")],
        "stereo": [(front_end, "begin_points")],  # detect included
        "window": [(cross_frame, "absorbed_oldest"), (cross_frame, "minimised")],
        "covariance": [(WindowState, "newest_marginals")],
        "write": [(EstimatesWriter, "write")],
    }


def timed() -> dict[str, list[float]]:
    """Wrap the functions of `stages`: each adds its time to the last entry of its stage in what is returned."""
    times_ms: dict[str, list[float]] = {stage: [0.0] for stage in stages()}

    def wrap(function: Any, stage: str) -> Any:
        def inner(*args: Any, **named: Any) -> Any:
            began = time.perf_counter()
            try:
                return function(*args, **named)
            finally:
                times_ms[stage][-1] += 1e3 * (time.perf_counter() - began)

        return inner

    for stage, functions in stages().items():
        for owner, name in functions:
            setattr(owner, name, wrap(getattr(owner, name), stage))
    return times_ms


def spread(times_ms: list[float]) -> dict[str, float]:
    """p50 and p95 after the warm-up."""
    kept = times_ms[WARM_UP:] or times_ms
    return {"p50": float(np.percentile(kept, 50)), "p95": float(np.percentile(kept, 95))}


def run_replay(path: str, overrides: list[str]) -> dict[str, Any]:
    """The whole job of `stream-sfm replay`: read, decode, estimate, write."""
    from stream_sfm import FrameEstimate, read_config, replay

    times_ms = timed()
    steps_ms: list[float] = []

    def next_frame(estimate: FrameEstimate) -> None:
        steps_ms.append(sum(estimate.timings_ms.values()))
        for times in times_ms.values():
            times.append(0.0)

    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        summary = replay(path, folder, read_config(None, overrides), sinks=[AfterFrame(next_frame)]).summary
        wall_s = time.perf_counter() - began
    frames = summary["frames"]["estimated"] + summary["frames"]["lost"] + summary["frames"]["degraded"]
    thirds = np.array_split(np.array(steps_ms[WARM_UP:]), 3)
    return {
        "frames": frames,
        "cpu_ms_per_frame": 1e3 * cpu_s() / frames,
        "frames_per_s": frames / wall_s,
        "peak_rss_mib": memory_mib("VmHWM"),
        "step_ms": spread(steps_ms),
        "decode_wait_ms": summary["timing_ms"]["decode"],
        "stages_ms": {stage: spread(times) for stage, times in times_ms.items()},
        "last_third_over_first": float(np.median(thirds[2]) / np.median(thirds[0])),
        "ground_truth": {
            k: v for k, v in (summary.get("ground_truth") or {}).items() if k.startswith(("ate", "t_rel", "final"))
        },
    }


def run_floor(path: str, _: list[str]) -> dict[str, Any]:
    """Decoding the pair, and one pyramid of each image: what any method pays."""
    from stream_sfm.logs.recording.stereo_log import open_log

    frames = 0
    for frame in open_log(path).frames():
        for image in (frame.left, frame.right):
            cv2.buildOpticalFlowPyramid(image, LK["winSize"], LK["maxLevel"])
        frames += 1
    return {"frames": frames, "cpu_ms_per_frame": 1e3 * cpu_s() / frames}


def run_loop(path: str, _: list[str]) -> dict[str, Any]:
    """Plain OpenCV frame to frame: corners, KLT left to right, forward and backward through time, PnP with RANSAC."""
    from stream_sfm.camera.rectification import Rectifier
    from stream_sfm.logs.recording.stereo_log import open_log

    log = open_log(path)
    rectifier = Rectifier(log.rig)
    p = rectifier.projection
    k = np.array([[p.f_px, 0, p.cx_left_px], [0, p.f_px, p.cy_px], [0, 0, 1]])
    before = None
    frames = 0
    for frame in log.frames():
        left, right = rectifier.rectify(frame.left, frame.right)
        if before is not None:
            old, corners, points = before
            now, found, _ = cv2.calcOpticalFlowPyrLK(old, left, corners, None, **LK)
            back, returned, _ = cv2.calcOpticalFlowPyrLK(left, old, now, None, **LK)
            good = (found[:, 0] > 0) & (returned[:, 0] > 0) & (np.linalg.norm(back - corners, axis=2)[:, 0] < 1)
            if good.sum() >= 6:
                cv2.solvePnPRansac(points[good], now[good], k, None, iterationsCount=200, reprojectionError=1.0)
        corners = cv2.goodFeaturesToTrack(left, 600, 0.01, 8)
        other, found, _ = cv2.calcOpticalFlowPyrLK(left, right, corners, None, **LK)
        shift = corners[:, 0] - other[:, 0]
        disparity = shift[:, 0] - (p.cx_left_px - p.cx_right_px)
        good = (found[:, 0] > 0) & (np.abs(shift[:, 1]) < 1.5) & (disparity > 0.5)
        corners, depth = corners[good], p.f_px * p.baseline_m / disparity[good]
        rays = (corners[:, 0] - (p.cx_left_px, p.cy_px)) / p.f_px
        before = left, corners, np.c_[rays * depth[:, None], depth]
        frames += 1
    return {"frames": frames, "cpu_ms_per_frame": 1e3 * cpu_s() / frames}


def run_step(path: str, overrides: list[str]) -> dict[str, Any]:
    """Memory of the engine alone: 400 steps over 20 decoded frames, there and back."""
    from stream_sfm import Engine, Selection, StereoFrame, open_log, read_config

    log = open_log(path)
    imports_mib = memory_mib("VmRSS")
    frames = list(log.frames(Selection(max_frames=20)))
    engine = Engine(log.rig, read_config(None, overrides))
    engine.step(frames[0])
    before_mib = memory_mib("VmRSS")
    peak_mib, stamp_ns = before_mib, frames[0].stamp_ns
    there_and_back = frames[1:] + frames[-2::-1]
    for index in range(400):
        frame = there_and_back[index % len(there_and_back)]
        stamp_ns += 100_000_000
        engine.step(StereoFrame(stamp_ns, frame.left, frame.right))
        peak_mib = max(peak_mib, memory_mib("VmRSS"))
    images_mib = sum(f.left.nbytes + f.right.nbytes for f in frames) / 2**20
    return {"above_images_mib": peak_mib - images_mib - imports_mib, "growth_mib": peak_mib - before_mib}


def run_budget(path: str, overrides: list[str]) -> dict[str, Any]:
    """CPU of a step by language, ms, and the sizes of the window's system; `prepare` included, in one thread.

    The sizes are means: unknowns of the frames (poses, and what a frame has of its own), modes of the prior, errors of
    the rig, and their sum, into which points are eliminated.
    """
    from stream_sfm import Engine, Selection, core, open_log, read_config

    spent_s: Counter[str] = Counter()

    def timed_as(language: str, function: Any) -> Any:
        def inner(*args: Any, **named: Any) -> Any:
            began_s = time.thread_time()
            try:
                return function(*args, **named)
            finally:
                spent_s[language] += time.thread_time() - began_s

        return inner

    for language, module, kind in (("core", core, "nb_func"), ("OpenCV", cv2, "builtin_function_or_method")):
        for name, each in list(vars(module).items()):
            if type(each).__name__ == kind:
                setattr(module, name, timed_as(language, each))
    cv2.setNumThreads(1)
    log = open_log(path)
    engine = Engine(log.rig, read_config(None, overrides))
    sizes: list[list[int]] = []
    for n, frame in enumerate(log.frames(Selection(max_frames=WARM_UP + 50))):
        if n == WARM_UP:
            spent_s.clear()
        began_s = time.thread_time()
        engine.step(frame)
        spent_s["all"] += time.thread_time() - began_s
        if n >= WARM_UP and (now := getattr(engine.lane.estimator, "map", None)) is not None:
            of = now.prior.of_modes
            sizes.append([6 * len(now.frames) + now.own.size, of["own"].stop, len(now.prior.rig)])
    ms = {language: 1e3 * spent_s[language] / max(1, n + 1 - WARM_UP) for language in ("all", "core", "OpenCV")}
    frames, modes, rig = np.mean(sizes, axis=0).tolist() if sizes else (0.0, 0.0, 0.0)
    return {
        "ms": {
            "core": ms["core"],
            "OpenCV": ms["OpenCV"],
            "Python and NumPy": ms["all"] - ms["core"] - ms["OpenCV"],
        },
        "unknowns": {"of frames": frames, "modes": modes, "of the rig": rig, "all": frames + modes + rig},
    }


def run_samples(path: str, overrides: list[str]) -> dict[str, float]:
    """CPU of a step without and with inertial samples, ms, median of frames at which two engines take turns.

    Empty for a log without samples.
    """
    from stream_sfm import Engine, Selection, open_log, read_config

    cv2.setNumThreads(1)
    log = open_log(path)
    if log.imu_topics is None:
        return {}
    engines = [Engine(log.rig, read_config(None, overrides)) for _ in range(2)]
    spent_ms: tuple[list[float], list[float]] = ([], [])
    for n, frame in enumerate(log.frames(Selection(max_frames=WARM_UP + 50))):
        frames = replace(frame, imu=None), frame
        for k in (0, 1) if n % 2 else (1, 0):
            began_s = time.thread_time()
            engines[k].step(frames[k])
            spent_ms[k].append(1e3 * (time.thread_time() - began_s))
    without, with_samples = (float(np.median(times[WARM_UP:])) for times in spent_ms)
    return {"without samples": without, "with samples": with_samples}


def run_window(_: str, overrides: list[str]) -> dict[str, Any]:
    """The estimator with covariances on simulated views: 200 points a frame, each seen in 12 frames."""
    from stream_sfm import read_config
    from stream_sfm.estimators import make_estimator
    from stream_sfm.simulation.scenes import Scene

    sequence = Scene(frames=60, track_length=12, visible=200).sequence(np.random.SeedSequence(0))
    estimator = make_estimator("cross-frame", sequence.projection, read_config(None, overrides))
    times_ms, steps_ms = timed(), []
    for observations in sequence.observations:
        began = time.perf_counter()
        estimator.step(observations)
        steps_ms.append(1e3 * (time.perf_counter() - began))
        for times in times_ms.values():
            times.append(0.0)
    solve = np.array(times_ms["window"]) + np.array(times_ms["covariance"])
    return {"solve_ms": spread(solve.tolist()), "step_ms": spread(steps_ms)}


def run_scaled(path: str, settings: list[str]) -> dict[str, Any]:
    """The engine on images of another size; `settings` is ["scale=0.5"]."""
    from stream_sfm import Camera, Engine, StereoFrame, StereoRig, open_log

    scale = float(settings[0].partition("=")[2])
    log = open_log(path)

    def scaled(camera: Camera) -> Camera:
        k = np.diag([scale, scale, 1]) @ camera.K
        width, height = round(scale * camera.width), round(scale * camera.height)
        return Camera(width, height, k, camera.D, camera.distortion_model)

    engine = Engine(StereoRig(scaled(log.rig.left), scaled(log.rig.right), log.rig.right_from_left))
    size = (engine.rig.left.width, engine.rig.left.height)
    frames = 0
    for frame in log.frames():
        left, right = (cv2.resize(i, size, interpolation=cv2.INTER_AREA) for i in (frame.left, frame.right))
        engine.step(StereoFrame(frame.stamp_ns, left, right))
        frames += 1
    return {"frames": frames, "cpu_ms_per_frame": 1e3 * cpu_s() / frames}


JOBS = {
    "replay": run_replay,
    "floor": run_floor,
    "loop": run_loop,
    "step": run_step,
    "calls": run_calls,
    "budget": run_budget,
    "samples": run_samples,
    "scaled": run_scaled,
    "window": run_window,
}

if __name__ == "__main__":
    print(json.dumps(JOBS[sys.argv[1]](sys.argv[2], sys.argv[3:])))
