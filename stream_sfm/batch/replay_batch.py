"""Replays many logs: finds them, replays each in its own process, and collects the results in one file and one page."""

import os
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, ThreadPoolExecutor, wait
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec

from .. import __version__
from ..camera.calibration.document import Where
from ..camera.rig import checked_paths
from ..config import Config, config_to_toml
from ..errors import require_study
from ..estimators import check_method
from ..logs.recording.truth_file import GroundTruthFile
from ..report.pages import PAGE_OF_LOG, render_batch, render_log
from ..system.executors import cluster
from ..system.files import json_bytes, make_folder, write_whole
from ..system.interrupts import deferred_interrupts
from ..system.outputs import only_writer, refuse_overwriting
from ..types import Selection
from .job import FILES, POLL_S, Job, JobResult, read_summary, run_job
from .logs import find_logs, names_for, truth_files

SCHEMA_VERSION = 1
RECORD, PAGE = "batch.json", "report.html"
_LOST = "the scheduler of the cluster, or its last worker, is gone or silent: start it again, and the same batch"


def replay_batch(
    logs: Sequence[str | Path],
    out_dir: str | Path,
    config: Config | None = None,
    selection: Selection | None = None,
    *,
    left: str | None = None,
    right: str | None = None,
    calibration: Where | None = None,
    rate_hz: float | None = None,
    ground_truth: str | Path | GroundTruthFile | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    on_done: Callable[[JobResult], None] | None = None,
) -> dict[str, Any]:
    """Replay many logs, each in its own process, into one folder per log, and return the content of batch.json.

    `logs`: recordings of any kind, folders of them, patterns. `left`, `right`, `calibration`, `rate_hz`: as in
    `open_log`. `ground_truth`: a file for all logs, or a folder with files named after the logs, instead of that in
    the logs. `workers` processes of this machine (None: one per core) do the work, or those of the Dask
    `scheduler`. `on_done` is called with each result. A second call processes only what is missing or has changed.
    On the first Ctrl-C or SIGTERM, running replays end after their current frame, and no further one is started.
    Raises ConfigError, LogError and OutputError before any log is started.
    """
    config, out = config or Config(), Path(out_dir).resolve()
    config.needs_scale("a batch, which compares metres,")
    require_study("the page of a batch")
    check_method(config.method)
    calibrations = [] if calibration is None else checked_paths(calibration)
    truth = ground_truth if isinstance(ground_truth, GroundTruthFile | None) else GroundTruthFile(ground_truth)
    skipped: list[str] = []
    names = names_for(find_logs([str(log) for log in logs], skipped), reserved=(RECORD, PAGE))
    truths = {} if truth is None else truth_files(Path(truth.path).resolve(), names)
    options = _options(left, right, rate_hz, selection or Selection(), truth)
    stop = out / f".stop-{uuid.uuid4().hex}"  # a name that no file of the user or of another batch has
    toml = config_to_toml(config)
    jobs = _jobs(out, names, truths, calibrations, (toml, options, stop))
    outputs = [out / RECORD, out / PAGE, *(job.folder / name for job in jobs for name in FILES)]
    refuse_overwriting(outputs, [*names, *calibrations, *truths.values()])
    with cluster(scheduler) if scheduler else _threads(workers or os.cpu_count() or 1) as (executor, lost):
        make_folder(out)
        with only_writer(out):
            started_s = time.monotonic()
            results, interrupted = _run_jobs(executor, lost, jobs, stop, on_done)
            of_batch: dict[str, Any] = {"method": config.method, "configuration": toml, "options": options}
            of_batch |= {"skipped": skipped, "interrupted": interrupted, "wall_s": time.monotonic() - started_s}
            content = _record(of_batch, jobs, results)
            write_whole(out / RECORD, json_bytes(content))
            write_whole(out / PAGE, render_batch(content, out).encode())
    return content


def _finished(job: Job, result: JobResult) -> dict[str, Any]:
    """Return the entry of a log in batch.json; its page is written if it has been estimated."""
    log = msgspec.to_builtins(result) | {"summary": read_summary(job.folder) if result.key else None}
    if log["summary"]:
        write_whole(job.folder / PAGE_OF_LOG, render_log(log, job.folder).encode())
    return log


def _options(
    left: str | None, right: str | None, rate_hz: float | None, chosen: Selection, truth: GroundTruthFile | None
) -> list[str]:
    """Return the choices as options of the command `replay`, which the process of each log runs."""
    frame = truth.frame if truth is not None else None
    if frame is not None and os.path.isfile(frame):
        frame = os.path.abspath(frame)  # for a process in another folder
    values = {
        "left": left,
        "right": right,
        "rate": rate_hz,
        "start": chosen.start_s,
        "end": chosen.end_s,
        "max-frames": chosen.max_frames,
        "stride": chosen.stride if chosen.stride > 1 else None,
        "ground-truth-frame": frame,
        "ground-truth-offset": (truth.offset_s or None) if truth is not None else None,
    }
    return [f"--{name}={value}" for name, value in values.items() if value is not None]


def _run_jobs(
    executor: Executor,
    lost: Callable[[], bool],
    jobs: Sequence[Job],
    stop: Path,
    on_done: Callable[[JobResult], None] | None,
) -> tuple[list[JobResult], bool]:
    """Return the results in the order of the jobs, and whether a signal ended the batch."""
    results: dict[Job, JobResult] = {}
    with deferred_interrupts() as interruption:
        futures = {executor.submit(run_job, job): job for job in jobs}
        waiting = set(futures)
        try:
            while waiting and not lost():
                ended, waiting = wait(waiting, POLL_S, FIRST_COMPLETED)
                for future in ended:
                    job = futures[future]
                    try:
                        results[job] = future.result()
                    except CancelledError:  # Dask has lost its scheduler
                        results[job] = job.ended("failed", _LOST)
                    except Exception as error:  # the worker itself was lost, or cannot write
                        results[job] = job.ended("failed", f"{type(error).__name__}: {error}")
                    if on_done is not None:
                        on_done(results[job])
                if interruption.requested:
                    stop.touch()
        except BaseException:  # a second Ctrl-C: stop waiting for jobs
            stop.touch()
            for future in waiting:
                future.cancel()
            raise
    stop.unlink(missing_ok=True)
    return [results.get(job) or job.ended("failed", _LOST) for job in jobs], interruption.requested


@contextmanager
def _threads(count: int) -> Iterator[tuple[Executor, Callable[[], bool]]]:
    """Yield threads that wait for the replaying processes, as `cluster` yields its executor; they are never lost."""
    with ThreadPoolExecutor(count) as pool:
        yield pool, lambda: False


def _record(of_batch: dict[str, Any], jobs: list[Job], results: list[JobResult]) -> dict[str, Any]:
    """Return the content of batch.json, from what is known of the batch as a whole."""
    return {
        "schema_version": SCHEMA_VERSION,
        "software_version": __version__,
        **of_batch,
        "complete": all(result.status == "done" for result in results),
        "counts": dict(Counter(result.status for result in results)),
        "reused": sum(result.reused for result in results),
        "logs": [_finished(job, result) for job, result in zip(jobs, results, strict=True)],
    }


def _jobs(
    out: Path,
    names: dict[Path, str],
    truths: dict[Path, Path],
    calibrations: list[Path],
    of_all: tuple[str, list[str], Path],
) -> list[Job]:
    """Return a job per log. `of_all`: configuration, options, and the file that stops all jobs."""
    (toml, options, stop), jobs = of_all, []
    for log, name in names.items():
        inputs = [("calibration", path) for path in calibrations]
        inputs += [("ground-truth", truths[log])] if log in truths else []
        named = (f"--{option}={path}" for option, path in inputs)
        jobs.append(Job(name, log, out / name, toml, (*options, *named), tuple(path for _, path in inputs), stop))
    return jobs
