"""Run the jobs of all logs on an executor, and collect their results in batch.json and one page."""

import time
import uuid
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from pathlib import Path
from typing import Any

import msgspec

from .. import __version__
from ..config import Config, config_to_toml
from ..estimators import check_method
from ..files import json_bytes, make_folder, write_whole
from ..interrupts import deferred_interrupts
from ..outputs import only_writer, refuse_overwriting
from ..report.batch_page import render_batch
from .job import FILES, Job, JobResult, read_summary, run_job
from .logs import names_for
from .truth import truth_files

SCHEMA_VERSION = 1
RECORD, PAGE = "batch.json", "report.html"
_POLL_S = 0.2  # how soon a Ctrl-C is passed on to the jobs


def run_batch(
    logs: Mapping[Path, int],
    out: Path,
    config: Config,
    executor: Executor,
    *,
    options: Sequence[str] = (),
    calibration: Sequence[Path] = (),
    truth: Path | None = None,
    timeout_s: float = 600.0,
    skipped: Sequence[str] = (),
    on_done: Callable[[JobResult], None] | None = None,
) -> dict[str, Any]:
    """Replay each log into `out`/<name> and return the content of batch.json.

    `logs` as `find_logs` returns them; `options` are further arguments of `replay`; `truth` as in `truth_files`; a log
    that delivers no frame for `timeout_s` is stopped; `skipped` says what was found but is not a log; `on_done` is
    called with the result of each log. On the first Ctrl-C or SIGTERM the running replays end after their current
    frame, and no further one is started. Raises ConfigError and OutputError before any replay is started.
    """
    check_method(config.method)
    out = out.resolve()
    stop = out / f".stop-{uuid.uuid4().hex}"  # no name that a file of the user, or another batch, could have
    toml = config_to_toml(config)
    names = names_for(logs, reserved=(RECORD, PAGE))
    truths = {} if truth is None else truth_files(truth, names)
    jobs = [
        Job(name, log, out / name, toml, tuple(options), tuple(calibration), truths.get(log), timeout_s, stop)
        for log, name in names.items()
    ]
    outputs = [out / RECORD, out / PAGE, *(job.folder / name for job in jobs for name in FILES)]
    refuse_overwriting(outputs, [*logs, *calibration, *truths.values()])
    make_folder(out)
    with only_writer(out):
        known = {"method": config.method, "configuration": toml, "options": list(options), "skipped": list(skipped)}
        return _run_and_record(out, jobs, known, executor, on_done)


def _run_and_record(
    out: Path,
    jobs: Sequence[Job],
    known: dict[str, Any],
    executor: Executor,
    on_done: Callable[[JobResult], None] | None,
) -> dict[str, Any]:
    """Run all jobs, and write batch.json, with what is `known` of the batch, and the page."""
    started_s = time.monotonic()
    results, interrupted = _run_jobs(executor, jobs, on_done)
    ended = {"interrupted": interrupted, "wall_s": time.monotonic() - started_s}
    content = _content(jobs, results) | known | ended
    write_whole(out / RECORD, json_bytes(content))
    write_whole(out / PAGE, render_batch(content, out).encode())
    return content


def _content(jobs: Sequence[Job], results: Sequence[JobResult]) -> dict[str, Any]:
    """The part of batch.json that follows from the results of the jobs."""
    return {
        "schema_version": SCHEMA_VERSION,
        "software_version": __version__,
        "complete": all(result.status == "done" for result in results),
        "counts": dict(Counter(result.status for result in results)),
        "reused": sum(result.reused for result in results),
        "logs": [
            msgspec.to_builtins(result) | {"summary": read_summary(job.folder) if result.key else None}
            for job, result in zip(jobs, results, strict=True)
        ],
    }


def _run_jobs(
    executor: Executor, jobs: Sequence[Job], on_done: Callable[[JobResult], None] | None
) -> tuple[list[JobResult], bool]:
    """The results in the order of the jobs, and whether a signal ended the batch."""
    results: dict[str, JobResult] = {}
    with deferred_interrupts() as interruption:
        futures = {executor.submit(run_job, job): job for job in jobs}
        waiting = set(futures)
        try:
            while waiting:
                ended, waiting = wait(waiting, _POLL_S, FIRST_COMPLETED)
                for future in ended:
                    job = futures[future]
                    results[job.name] = _result(future, job)
                    if on_done is not None:
                        on_done(results[job.name])
                if interruption.requested:
                    jobs[0].stop.touch()
        except BaseException:  # a second Ctrl-C: no job is waited for any longer
            jobs[0].stop.touch()
            for future in waiting:
                future.cancel()
            raise
    if jobs:
        jobs[0].stop.unlink(missing_ok=True)
    return [results[job.name] for job in jobs], interruption.requested


def _result(future: Future[JobResult], job: Job) -> JobResult:
    try:
        return future.result()
    except Exception as error:  # the worker itself was lost, or cannot write
        reason = f"{type(error).__name__}: {error}"
        return JobResult(name=job.name, log=str(job.log), status="failed", reason=reason)
