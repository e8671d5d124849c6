"""Compares methods over many logs, or over many starts of one: the answer that one log cannot give.

Each job compares the methods on one log from one start, in a process of its own. One log is one sample: its starts are
averaged first, and the interval of a ratio is Student's over the logs. Of one log, starts that share no frame are its
samples. Starts that share frames share their errors, too: together they are worth hardly more than one run, and the
interval is no narrower than that of one.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import __version__
from ..camera.calibration.read import Where
from ..camera.rig import checked_paths
from ..config import Config, config_to_toml
from ..errors import ConfigError, StreamSfmError
from ..estimators import check_method
from ..executors import cluster, processes
from ..files import json_bytes, make_folder, write_whole
from ..geometry.se3 import Array
from ..report.many_page import conclusion_of_many, render_many
from ..types import Selection
from .compare import COMPARED, compare
from .refine import check_calibrates

SCHEMA_VERSION = 1
RECORD, PAGE = "comparison.json", "report.html"
REFERENCE = "cross-frame"
QUANTITIES = ("position", "rotation")
_CONFIDENCE = 0.95
_MIN_SAMPLES = 3  # two know nothing about their spread


class Start(NamedTuple):
    """One sample: a log from `start_s` on."""

    log: Path
    start_s: float


def compare_many(
    logs: Sequence[str | Path],
    out_dir: str | Path | None = None,
    config: Config | None = None,
    selection: Selection | None = None,
    *,
    left: str | None = None,
    right: str | None = None,
    calibration: Where | None = None,
    calibrate: bool = False,
    methods: Sequence[str] = COMPARED,
    starts: int = 1,
    start_step_s: float = 1.0,
    workers: int | None = None,
    scheduler: str | None = None,
    on_done: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Compare methods on many logs and return the content of comparison.json, written to `out_dir` with a page.

    `left`, `right`, `calibration`: as in `open_log`, for all logs. `calibrate`: as in `compare`; each run learns from
    its own frames. `starts`: each log is run from so many starts, `start_step_s` apart. `workers` processes of this
    machine (None: one per core), or those of the Dask `scheduler`. A log that cannot be compared is listed with its
    reason. `on_done` is called with the name and start of each. Ctrl-C ends it with what has been compared until then,
    `interrupted` in the content. Raises ConfigError, OutputError; KeyboardInterrupt where nothing was compared yet.
    """
    config, selection = config or Config(), selection or Selection()
    config.needs_scale("compare")
    for name in methods:
        check_method(name)
    if REFERENCE not in methods:
        raise ConfigError(f"ratios are over {REFERENCE}: name it among the methods")
    if calibrate:
        check_calibrates(config)
    if starts < 1 or start_step_s <= 0:
        raise ConfigError(f"{starts} starts, {start_step_s:g} s apart: give at least one, and a distance above 0")
    folder = None if out_dir is None else Path(out_dir)
    if folder is not None:
        make_folder(folder)
    first_s = selection.start_s or 0.0
    jobs = [Start(Path(log), first_s + k * start_step_s) for log in logs for k in range(starts)]
    files: list[Path] | None = None if calibration is None else checked_paths(calibration)
    options = {
        "methods": tuple(methods),
        "left": left,
        "right": right,
        "calibration": files,
        "calibrate": calibrate,
    }
    run = partial(run_start, config=config, selection=selection, options=options)
    done: dict[int, dict[str, Any]] = {}
    interrupted = False
    try:
        with cluster(scheduler) if scheduler else processes(workers or os.cpu_count() or 1) as executor:
            _run_all(executor, run, jobs, done, on_done)
    except KeyboardInterrupt:
        if not done:
            raise
        interrupted = True
    samples = [done.get(k) or _failed(job, "interrupted before its end") for k, job in enumerate(jobs)]
    content = summarise_many(samples, methods)
    content |= {"interrupted": interrupted, "configuration": config_to_toml(config)}
    if folder is not None:
        write_whole(folder / RECORD, json_bytes(content))
        write_whole(folder / PAGE, render_many(content).encode())
    return content


def run_start(job: Start, config: Config, selection: Selection, options: dict[str, Any]) -> dict[str, Any]:
    """Compare on one log from one start; a failure is a result, not an exception. `options`: of `compare`."""
    try:
        selected = replace(selection, start_s=job.start_s)
        result = compare(job.log, None, config, selected, **options)
    except (StreamSfmError, ValueError) as error:
        return _failed(job, str(error))
    report = result.report
    ratios, intervals = (
        {key: {q: found[q][what] for q in QUANTITIES} for key, found in report["error_over_cross_frame"].items()}
        for what in ("value", "ci95")
    )
    stamps_ns = result.comparison.runs[0].stamps_ns
    nees = {key: m["nees_pose_mean"] for key, m in report["methods"].items()}
    failure = None if ratios else "no ratios: too few frames with ground truth in a row, or a method that stopped"
    return {
        "log": str(job.log),
        "start_s": job.start_s,
        "end_s": job.start_s + float(stamps_ns[-1] - stamps_ns[0]) / 1e9,
        "failure": failure,
        "ratios": ratios,
        "ci95": intervals,
        "nees_pose_mean": nees,
        "frames": report["frames_with_ground_truth"],
    }


def _run_all(
    executor: Executor,
    run: Callable[[Start], dict[str, Any]],
    jobs: Sequence[Start],
    done: dict[int, dict[str, Any]],
    on_done: Callable[[str], None] | None,
) -> None:
    """Add the sample of each job to `done`, by its place among the jobs; one whose process was lost is a failure."""
    futures = {executor.submit(run, job): k for k, job in enumerate(jobs)}
    for future in as_completed(futures):
        k = futures[future]
        try:
            done[k] = future.result()
        except Exception as error:
            done[k] = _failed(jobs[k], f"{type(error).__name__}: {error}")
        if on_done is not None:
            on_done(f"{jobs[k].log.name} from {jobs[k].start_s:g} s")


def _failed(job: Start, failure: str) -> dict[str, Any]:
    return {"log": str(job.log), "start_s": job.start_s, "failure": failure, "ratios": {}}


def summarise_many(samples: Sequence[dict[str, Any]], methods: Sequence[str]) -> dict[str, Any]:
    """The content of comparison.json: the samples, and for each method ratios over all logs with intervals."""
    good = [s for s in samples if s["ratios"]]
    logs = list(dict.fromkeys(s["log"] for s in good))
    over = "logs" if len(logs) > 1 else "frames" if _share_frames(good) else "starts"
    overall: dict[str, Any] = {}
    for name in methods:
        key = name.replace("-", "_")
        if name == REFERENCE or not any(key in s["ratios"] for s in good):
            continue
        overall[key] = {q: _figure(good, logs, key, q, over) for q in QUANTITIES}
    content = {
        "schema_version": SCHEMA_VERSION,
        "software_version": __version__,
        "samples": list(samples),
        "logs": len(logs),
        "interval_over": over,
        "error_over_cross_frame": overall,
    }
    return content | {"conclusion": " ".join(conclusion_of_many(content))}


def _share_frames(samples: Sequence[dict[str, Any]]) -> bool:
    """Whether a start of a log lies before the end of the run before it; also of a single run, whose frames are all."""
    runs = sorted((s["start_s"], s["end_s"]) for s in samples)
    return len(runs) == 1 or any(start_s <= end_s for (_, end_s), (start_s, _) in pairwise(runs))


def _figure(
    samples: Sequence[dict[str, Any]], logs: Sequence[str], key: str, quantity: str, over: str
) -> dict[str, Any]:
    """The geometric mean of a ratio with its interval, None where nothing is known of its spread."""
    runs = [s for s in samples if key in s["ratios"]]
    found = [(s["log"], float(np.log(s["ratios"][key][quantity]))) for s in runs]
    if over == "logs":
        of_logs = [[value for log, value in found if log == wanted] for wanted in logs]
        found = [("", float(np.mean(values))) for values in of_logs if values]
    x = np.array([value for _, value in found])
    halves = [_students(x)] if len(x) >= _MIN_SAMPLES else []
    if over == "frames":
        halves.append(float(np.mean([0.5 * np.diff(np.log(s["ci95"][key][quantity]))[0] for s in runs])))
    ends = [float(np.exp(x.mean() + sign * max(halves))) for sign in (-1, 1)] if halves else None
    return {"value": float(np.exp(x.mean())), "ci95": ends, "samples": len(x)}


def _students(x: Array) -> float:
    """Half the width of Student's interval of the mean; position and rotation hold together in 95 % of cases."""
    from scipy.special import stdtrit

    of_both = 1 - (1 - _CONFIDENCE) / 2
    return float(stdtrit(len(x) - 1, 0.5 + of_both / 2) * x.std(ddof=1) / np.sqrt(len(x)))
