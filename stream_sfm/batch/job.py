"""Replays one log of a batch in its own process, so that it cannot affect the others.

A job waits for this process and records how it ended. It needs only files and the content of `Job`, so it
can run in a thread of the batch or on another machine that sees the same files.
"""

import hashlib
import os
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from signal import Signals
from typing import Any, Literal, TypeVar

import msgspec

from .. import __version__
from ..errors import ExitCode, OutputError
from ..report.pages import PAGE_OF_LOG
from ..system.executors import ONE_THREAD
from ..system.files import json_bytes, write_whole
from ..system.inputs import open_regular
from ..system.outputs import RESULTS, only_writer

T = TypeVar("T")

_RECORD, _STDERR = "job.json", "stderr.txt"
FILES = (*RESULTS, _RECORD, _STDERR, PAGE_OF_LOG)  # files that a job and the batch write to its folder
_ERROR_PREFIX = "stream-sfm: "  # prefix of an error on the command line
JobStatus = Literal["done", "incomplete", "failed", "interrupted"]
POLL_S = 0.2  # interval of checks for a request to end
_SHUTDOWN_S = 20.0  # for a replay to end after a request, with its current frame; then it is killed


class JobResult(msgspec.Struct, frozen=True, kw_only=True):
    """How a job ended; the file job.json in its folder has the same content.

    `status`: done; incomplete (only part of the log could be read and estimated); failed; interrupted. `key` is
    equal for equal log content, configuration, selection and software, and empty if no replay was started.
    `reused`: an earlier batch had already done this job.
    """

    name: str
    log: str
    status: JobStatus
    reason: str = ""
    seconds: float = 0.0
    key: str = ""
    software_version: str = __version__
    reused: bool = False


@dataclass(frozen=True, slots=True)
class Job:
    """One log to replay; `log` and `folder` are absolute paths.

    `options` are further arguments of `replay`; `inputs` the files that they name. The file `stop` ends the replay.
    `software_version`: of the batch, which a worker on another machine may not have.
    """

    name: str
    log: Path
    folder: Path
    config_toml: str
    options: tuple[str, ...]
    inputs: tuple[Path, ...]
    stop: Path
    software_version: str = field(default_factory=lambda: __version__)

    def ended(self, status: JobStatus, reason: str, **known: Any) -> JobResult:
        """The result of this job. Bytes of the path that are not UTF-8 are escaped: such a log fails and is listed."""
        log = os.fsencode(self.log).decode(errors="backslashreplace")
        return JobResult(name=self.name, log=log, status=status, reason=reason, **known)


def run_job(job: Job) -> JobResult:
    """Run a job unless an earlier one did the same; a failure of any kind is a result, not an exception."""
    if job.stop.exists():
        return job.ended("interrupted", "not started")
    if job.software_version != __version__:
        versions = f"its worker has stream-sfm {__version__}, and the batch {job.software_version}"
        return job.ended("failed", f"{versions}: install the same version on both")
    try:
        return _done_before(job, key := _fingerprint(job)) or _run(job, key)
    except OSError as error:
        return job.ended("failed", f"{error.filename or job.log}: {error.strerror}")
    except OutputError as error:
        return job.ended("failed", str(error))


def _done_before(job: Job, key: str) -> JobResult | None:
    """Return the result of an earlier job that did the same, or a refusal if the folder is not ours; else None."""
    own: JobResult | None = _decoded(job.folder / _RECORD, JobResult)
    if own is None:
        foreign = [name for name in RESULTS if os.path.lexists(job.folder / name)]
        reason = f"{job.folder} holds files that no batch wrote ({', '.join(foreign)}): choose another folder"
        return job.ended("failed", reason) if foreign else None
    now = job.ended(own.status, own.reason, seconds=own.seconds, key=key, reused=True)
    complete = own.status in ("done", "incomplete") and all((job.folder / name).exists() for name in RESULTS)
    if complete and own.key == key:
        return now
    reason = f"{job.folder} holds the results of another log, {own.log}: choose another folder"
    return job.ended("failed", reason) if own.log != now.log else None


def _run(job: Job, key: str) -> JobResult:
    """Replay the log, and record how it went."""
    started_s = time.monotonic()
    job.folder.mkdir(parents=True, exist_ok=True)
    with only_writer(job.folder):  # results of earlier attempts are removed; other files stay
        for name in FILES:
            (job.folder / name).unlink(missing_ok=True)
            (job.folder / f"{name}.part").unlink(missing_ok=True)
    # Written first, so that the remains of an ended batch are recognised as ours.
    write_whole(job.folder / _RECORD, json_bytes(job.ended("interrupted", "not finished")))
    status, reason = _replay(job)
    result = job.ended(status, reason, seconds=time.monotonic() - started_s, key=key)
    write_whole(job.folder / _RECORD, json_bytes(result))
    return result


def read_summary(folder: Path) -> dict[str, Any] | None:
    """Return the content of the summary.json of a replay, None if there is none."""
    return _decoded(folder / "summary.json", dict[str, Any])


def _decoded(path: Path, kind: type[T]) -> T | None:
    """Return the content of a JSON file; None if it is missing or of another kind."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=kind)
    except (OSError, msgspec.DecodeError):
        return None


def _fingerprint(job: Job) -> str:
    """Return the SHA-256 of the log and of everything else on which its results depend."""
    parts = [job.config_toml, job.options, [_sha256(path) for path in (job.log, *job.inputs)], __version__]
    return hashlib.sha256(msgspec.json.encode(parts)).hexdigest()


def _sha256(path: Path) -> str:
    """Return the digest of a file, or of the names and contents of all files of a folder."""
    if not path.is_dir():
        with open_regular(path) as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()  # type: ignore[arg-type]
    digest = hashlib.sha256()
    for file in sorted(p for p in path.rglob("*") if p.is_file()):
        digest.update(f"{file.relative_to(path).as_posix()}\0{_sha256(file)}\0".encode(errors="surrogateescape"))
    return digest.hexdigest()


def _replay(job: Job) -> tuple[JobStatus, str]:
    """Replay in a separate process, and return status and reason."""
    config, errors = job.folder / "config.toml", job.folder / _STDERR
    config.write_text(job.config_toml, encoding="utf-8")
    # this package itself, whatever is in the current folder
    here = os.pathsep.join(filter(None, [os.environ.get("PYTHONPATH"), str(Path(__file__).parents[2])]))
    command = [sys.executable, "-P", "-m", "stream_sfm", "replay", f"--config={config}", *job.options]
    command += [f"--out={job.folder}", "--quiet", "--debug", str(job.log)]
    with (
        open(errors, "wb") as stderr,
        subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=stderr,
            env=os.environ | ONE_THREAD | {"PYTHONPATH": here},
            start_new_session=True,  # Ctrl-C reaches this process only; `stop` passes it on, once
        ) as child,
    ):
        try:
            interrupted = _watch(child, job)
        finally:
            child.kill()  # no effect if it has ended
    text = errors.read_text(encoding="utf-8", errors="replace")
    if not text:
        errors.unlink()
    return _classify(job, child.returncode, interrupted, text)


def _watch(child: subprocess.Popen[bytes], job: Job) -> bool:
    """Wait for the end; return whether `stop` caused it."""
    while True:
        with suppress(subprocess.TimeoutExpired):
            child.wait(POLL_S)
            return False
        if job.stop.exists():
            child.terminate()  # it ends after the current frame, with everything written
            with suppress(subprocess.TimeoutExpired):
                child.wait(_SHUTDOWN_S)
            return True


def _classify(job: Job, code: int, interrupted: bool, stderr: str) -> tuple[JobStatus, str]:
    """Return status and reason of a replay from exit code, whether it was asked to end, and standard error."""
    summary = read_summary(job.folder)
    if interrupted:
        return "interrupted", f"after {summary['frames']['estimated'] if summary else 0} frames"
    if code < 0:
        name = Signals(-code).name
        memory = ", as the system does when memory runs out" if name == "SIGKILL" else ""
        return "failed", f"its process was killed ({name}{memory})"
    errors = [line for line in stderr.splitlines() if line.startswith(_ERROR_PREFIX)]
    if errors:
        return "failed", errors[-1].removeprefix(_ERROR_PREFIX)
    if summary is None:
        return "failed", f"exit code {code}, see {job.folder / _STDERR}"
    if code == ExitCode.DONE:
        return "done", ""
    return "incomplete" if code == ExitCode.INPUT else "failed", "; ".join(summary["warnings"])
