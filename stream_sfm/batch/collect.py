"""All logs of a batch: their jobs to an executor, their outcomes into batch.json and one page."""

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from pathlib import Path
from typing import Any

import msgspec

from .. import __version__
from ..config import Config, config_to_toml
from ..errors import ConfigError, OutputError
from ..estimators import METHODS
from ..files import json_bytes, write_whole
from ..interrupts import signals_noted
from ..report.batch_page import render_batch
from .job import Job, Outcome, read_summary, run_job
from .logs import names_for

SCHEMA_VERSION = 1
RECORD, PAGE, STOP = "batch.json", "report.html", "stop"
_POLL_S = 0.2


def run_batch(
    logs: Mapping[Path, int],
    out: Path,
    config: Config,
    executor: Executor,
    *,
    options: Sequence[str] = (),
    calibration: Path | None = None,
    patience_s: float = 600.0,
    on_done: Callable[[Outcome], None] | None = None,
) -> dict[str, Any]:
    """Replay each log into `out`/<name>; returns the content of batch.json.

    `logs` as `find_logs` gives them; `options` are further arguments of `replay`; a log that gives no frame for
    `patience_s` is given up. With the first Ctrl-C or SIGTERM the logs in hand are ended after their present frame,
    and the rest is not begun. Raises ConfigError and OutputError before anything is begun.
    """
    if config.method not in METHODS:
        raise ConfigError(f"method {config.method!r} is not known; known are {', '.join(METHODS)}")
    out = out.resolve()
    stop = out / STOP
    try:
        out.mkdir(parents=True, exist_ok=True)
        stop.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"cannot write to {out}: {error.strerror}") from None
    began = time.monotonic()
    toml = config_to_toml(config)
    jobs = [
        Job(name, log, out / name, toml, tuple(options), calibration, patience_s, stop)
        for log, name in names_for(logs, reserved=(RECORD, PAGE, STOP)).items()
    ]
    outcomes, interrupted = _through(executor, jobs, on_done)
    content = {
        "schema_version": SCHEMA_VERSION,
        "software_version": __version__,
        "method": config.method,
        "complete": all(outcome.status == "done" for outcome in outcomes),
        "interrupted": interrupted,
        "counts": dict(Counter(outcome.status for outcome in outcomes)),
        "reused": sum(outcome.reused for outcome in outcomes),
        "wall_s": time.monotonic() - began,
        "configuration": toml,
        "options": list(options),
        "logs": [
            msgspec.to_builtins(outcome) | {"summary": read_summary(job.folder) if outcome.key else None}
            for job, outcome in zip(jobs, outcomes, strict=True)
        ],
    }
    write_whole(out / RECORD, json_bytes(content))
    write_whole(out / PAGE, render_batch(content, out).encode())
    return content


def _through(
    executor: Executor, jobs: Sequence[Job], on_done: Callable[[Outcome], None] | None
) -> tuple[list[Outcome], bool]:
    """The outcomes, in the order of the jobs, and whether a signal has ended the batch."""
    outcomes: dict[str, Outcome] = {}
    with signals_noted() as signals:
        futures = {executor.submit(run_job, job): job for job in jobs}
        waiting = set(futures)
        try:
            while waiting:
                ended, waiting = wait(waiting, _POLL_S, FIRST_COMPLETED)
                for future in ended:
                    job = futures[future]
                    outcomes[job.name] = _result(future, job)
                    if on_done is not None:
                        on_done(outcomes[job.name])
                if signals:
                    jobs[0].stop.touch()
        except BaseException:  # a second Ctrl-C: nobody waits any more
            jobs[0].stop.touch()
            for future in waiting:
                future.cancel()
            raise
    if jobs:
        jobs[0].stop.unlink(missing_ok=True)
    return [outcomes[job.name] for job in jobs], bool(signals)


def _result(future: Future[Outcome], job: Job) -> Outcome:
    try:
        return future.result()
    except Exception as error:  # the worker itself was lost, or cannot write
        reason = f"{type(error).__name__}: {error}"
        return Outcome(name=job.name, log=str(job.log), status="failed", reason=reason)
