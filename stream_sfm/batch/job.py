"""One log of a batch: replayed by a process of its own, so that nothing it does can harm the others.

The job waits for that process and writes down how it ended. It needs nothing but files and what is in `Job`, so it
runs in a thread of the batch as well as on another machine that sees the same files.
"""

import hashlib
import os
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from signal import Signals
from typing import Any, Literal

import msgspec

from .. import __version__
from ..errors import ExitCode
from ..executors import ONE_THREAD
from ..files import json_bytes, write_whole

RESULTS = ("estimates.mcap", "trajectory.tum", "trajectory.kitti", "summary.json", "config.toml")
_RECORD, _ERRORS = "job.json", "stderr.txt"
_COMPLAINT = "stream-sfm: "  # begins the line in which the command says what is wrong
Ending = Literal["done", "incomplete", "failed", "interrupted"]
_POLL_S = 0.2
GRACE_S = 20.0  # for a replay that is told to end: the frame in hand, and its files


@dataclass(frozen=True, slots=True)
class Job:
    """`log` and `folder` are absolute; `options` are further arguments of `replay`, `calibration` a file.

    The replay is ended when no frame has come for `patience_s`, or when the file `stop` appears.
    """

    name: str
    log: Path
    folder: Path
    config_toml: str
    options: tuple[str, ...]
    calibration: Path | None
    patience_s: float
    stop: Path


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """How a job ended, kept as job.json in its folder. `reused`: an earlier batch had already done it.

    `status`: done; incomplete (the log could be read in part only, the part is estimated); failed; interrupted.
    `key`: the same for the same bytes of the log, configuration, selection and software; "" where nothing was begun.
    """

    name: str
    log: str
    status: Ending
    reason: str = ""
    seconds: float = 0.0
    log_sha256: str = ""
    key: str = ""
    software_version: str = __version__
    reused: bool = False


def run_job(job: Job) -> Outcome:
    """Do the job unless an earlier one has done the same; every way in which it can fail is an outcome."""
    began = time.monotonic()
    if job.stop.exists():
        return _outcome(job, "interrupted", "not begun")
    try:
        log_sha256, key = _identity(job)
        earlier = _earlier(job.folder)
        if earlier is not None and earlier.status in ("done", "incomplete"):
            if earlier.key == key and all((job.folder / name).exists() for name in RESULTS):
                return msgspec.structs.replace(earlier, name=job.name, log=str(job.log), reused=True)
            if earlier.log_sha256 != log_sha256 and earlier.log != str(job.log):
                reason = f"{job.folder} holds the results of another log, {earlier.log}: choose another folder"
                return _outcome(job, "failed", reason)
        _clear(job.folder)
        status, reason = _replay(job)
        seconds = time.monotonic() - began
        outcome = _outcome(job, status, reason, seconds=seconds, log_sha256=log_sha256, key=key)
        write_whole(job.folder / _RECORD, json_bytes(outcome))
    except OSError as error:
        return _outcome(job, "failed", f"{error.filename or job.log}: {error.strerror}")
    return outcome


def _outcome(job: Job, status: Ending, reason: str, **known: Any) -> Outcome:
    return Outcome(name=job.name, log=str(job.log), status=status, reason=reason, **known)


def read_summary(folder: Path) -> dict[str, Any] | None:
    """The summary.json of a replay, None where there is none."""
    try:
        summary: dict[str, Any] = msgspec.json.decode((folder / "summary.json").read_bytes())
    except (OSError, msgspec.DecodeError):
        return None
    return summary


def _identity(job: Job) -> tuple[str, str]:
    """SHA-256 of the log, and of everything that its results depend on."""
    with open(job.log, "rb") as stream:
        log_sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
    calibration = job.calibration.read_bytes() if job.calibration else None
    parts = [log_sha256, job.config_toml, job.options, calibration, __version__]
    return log_sha256, hashlib.sha256(msgspec.json.encode(parts)).hexdigest()


def _earlier(folder: Path) -> Outcome | None:
    try:
        return msgspec.json.decode((folder / _RECORD).read_bytes(), type=Outcome)
    except (OSError, msgspec.DecodeError):
        return None


def _clear(folder: Path) -> None:
    """No file of an earlier attempt may be taken for one of this; other files are left alone."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in (*RESULTS, _RECORD, _ERRORS):
        (folder / name).unlink(missing_ok=True)
        (folder / f"{name}.part").unlink(missing_ok=True)


def _replay(job: Job) -> tuple[Ending, str]:
    """Status and reason of a replay in its own process."""
    config = job.folder / "config.toml"
    config.write_text(job.config_toml, encoding="utf-8")
    options = [*job.options, *([f"--calibration={job.calibration}"] if job.calibration else [])]
    command = [sys.executable, "-m", "stream_sfm.cli.supervised", "replay", f"--config={config}", *options]
    command += [f"--out={job.folder}", "--quiet", "--debug", str(job.log)]
    errors = job.folder / _ERRORS
    with (
        open(errors, "wb") as stderr,
        subprocess.Popen(
            command,
            stdin=subprocess.PIPE,  # closing it ends the replay, and so does the end of this process
            stdout=subprocess.DEVNULL,
            stderr=stderr,
            env=os.environ | ONE_THREAD,
            start_new_session=True,  # Ctrl-C is for us, and ends the replay by way of `stop`, once
        ) as child,
    ):
        try:
            ended_for = _watch(child, job)
        finally:
            child.kill()  # nothing, if it has ended
    said = errors.read_text(encoding="utf-8", errors="replace")
    if not said:
        errors.unlink()
    return _verdict(job, child.returncode, ended_for, said)


def _watch(child: subprocess.Popen[bytes], job: Job) -> str:
    """Wait for the end; "" or why it was brought about: "interrupted" or "hanging"."""
    written, since = 0, time.monotonic()
    while True:
        try:
            child.wait(_POLL_S)
            return ""
        except subprocess.TimeoutExpired:
            pass
        if (latest := _last_write_ns(job.folder)) != written:
            written, since = latest, time.monotonic()
        interrupted = job.stop.exists()
        if interrupted or time.monotonic() - since > job.patience_s:
            assert child.stdin is not None
            child.stdin.close()
            try:
                child.wait(GRACE_S)
            except subprocess.TimeoutExpired:
                child.kill()
            return "interrupted" if interrupted else "hanging"


def _last_write_ns(folder: Path) -> int:
    times = [0]
    for path in folder.iterdir():
        with suppress(FileNotFoundError):  # moved into place this moment
            times.append(path.stat().st_mtime_ns)
    return max(times)


def _verdict(job: Job, code: int, ended_for: str, said: str) -> tuple[Ending, str]:
    """What became of a replay: its exit code, why it was ended if it was, and its standard error."""
    summary = read_summary(job.folder)
    if ended_for == "interrupted":
        return "interrupted", f"after {summary['frames']['estimated'] if summary else 0} frames"
    if ended_for == "hanging":
        return "failed", f"given up because no frame came for {job.patience_s:g} s"
    if code < 0:
        name = Signals(-code).name
        memory = ", as the system does when memory runs out" if name == "SIGKILL" else ""
        return "failed", f"its process was killed ({name}{memory})"
    complaints = [line for line in said.splitlines() if line.startswith(_COMPLAINT)]
    if complaints:
        return "failed", complaints[-1].removeprefix(_COMPLAINT)
    if summary is None:
        return "failed", f"exit code {code}, see {job.folder / _ERRORS}"
    if code == 0:
        return "done", ""
    return "incomplete" if code == ExitCode.INPUT else "failed", "; ".join(summary["warnings"])
