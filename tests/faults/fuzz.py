"""Hostile inputs through the command line, in a worker that may hang, swell or die without taking the test along."""

import contextlib
import io
import json
import multiprocessing
import os
import signal
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

from stream_sfm.cli.main import main
from stream_sfm.results.trajectory_files import read_tum
from stream_sfm.run.summary import peak_rss_mib
from tests.faults.mutations import FRAMES, make_base, mutate

MAX_SECONDS = 5.0  # of CPU, for a damaged log: a busy machine is no failure
MAX_WAIT_S = 120  # of waiting for nothing
MAX_RSS_MIB = 1024

# (log, folder of results, stamps of the frames that are due, whether no loss can be hidden) -> (exit code, problem)
Replay = Callable[[Path, Path, list[int], bool], tuple[int, str]]
Trial = Callable[[int], tuple[int, int, str]]  # seed -> exit code, number of frames that were due, what is wrong


@dataclass
class Outcome:
    """What so many damaged logs came to. `failures`: seed -> what went wrong; `exit_codes` of the others."""

    tried: int = 0
    failures: dict[int, str] = field(default_factory=dict)
    exit_codes: Counter[int] = field(default_factory=Counter)
    frames_due: int = 0
    peak_rss_mib: float = 0.0


def replay_and_check(log: Path, out: Path, due: list[int], checked: bool) -> tuple[int, str]:
    """The exit code of `stream-sfm replay`, and what is wrong with it or with its results (empty: nothing)."""
    trajectory = out / "trajectory.tum"
    trajectory.unlink(missing_ok=True)
    printed, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(errors):
        code = main(["replay", str(log), "--out", str(out), "--json", "--method", "frame-to-frame"])
    if code not in (0, 3) or "Traceback" in errors.getvalue():
        return code, f"exit code {code}: {errors.getvalue()[-500:]}"
    estimated = read_tum(trajectory).stamps_ns.tolist() if trajectory.exists() else []
    if missing := set(due) - set(estimated):
        return code, f"{len(missing)} of {len(due)} intact leading frames are not estimated: {errors.getvalue()}"
    if code == 0:
        summary = json.loads(printed.getvalue())
        if not summary["complete"]:
            return code, "not complete, and the exit code does not say so"
        if checked and len(estimated) < FRAMES and not summary["warnings"]:
            return code, f"{len(estimated)} of {FRAMES} frames, and nothing said of the others"
    return code, ""


def damaged_logs(base_name: str, replay: Replay, folder: Path) -> Trial:
    """Replays of one base, damaged by the seed."""
    base = make_base(base_name, folder)
    log = folder / "damaged.mcap"

    def trial(seed: int) -> tuple[int, int, str]:
        kind, data = mutate(base, seed)
        log.write_bytes(data)
        due = base.leading(data)
        code, problem = replay(log, folder / "out", due, base.checksummed and kind != "change_inside")
        return code, len(due), problem and f"{kind}: {problem}"

    return trial


def fuzz_logs(base: str, first: int, count: int, folder: Path, replay: Replay = replay_and_check) -> Outcome:
    """Replay the logs of the seeds `first` … `first + count − 1`, made of one base."""
    return fuzz(partial(damaged_logs, base, replay), first, count, folder)


def fuzz(
    prepare: Callable[[Path], Trial], first: int, count: int, folder: Path, max_seconds: float = MAX_SECONDS
) -> Outcome:
    """Run the trial that `prepare` makes for the seeds `first` … `first + count − 1`.

    A seed that kills the worker is a failure; a new worker goes on with the next. `prepare` must be picklable.
    """
    outcome = Outcome()
    at, end = first, first + count
    server = multiprocessing.get_context(
        "forkserver"
    )  # not a fork of this one: the memory is to be the worker's own
    server.set_forkserver_preload(["tests.faults.attacks"])  # with everything imported
    while at < end:
        receive, send = server.Pipe(duplex=False)
        worker = server.Process(target=_work, args=(send, prepare, at, end, folder, max_seconds))
        worker.start()
        send.close()
        with receive, contextlib.suppress(EOFError):
            while True:
                code, due, rss_mib, problem = receive.recv()
                outcome.peak_rss_mib = max(outcome.peak_rss_mib, rss_mib)
                if problem:
                    outcome.failures[at] = problem
                else:
                    outcome.exit_codes[code] += 1
                outcome.frames_due += due
                at += 1
        worker.join()
        if at < end:
            hung = -(worker.exitcode or 0) in (signal.SIGPROF, signal.SIGALRM)
            outcome.failures[at] = f"the worker {'did not come back' if hung else 'died'} ({worker.exitcode})"
            at += 1
        worker.close()
    outcome.tried = at - first
    return outcome


def _work(
    send: Connection, prepare: Callable[[Path], Trial], first: int, end: int, folder: Path, max_seconds: float
) -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # image libraries write there what they think of damaged images
    trial = prepare(folder)
    for seed in range(first, end):
        # The default of both signals ends the process, also inside a library that does not come back.
        signal.setitimer(signal.ITIMER_PROF, max_seconds)
        signal.alarm(MAX_WAIT_S)
        code, due, problem = trial(seed)
        signal.setitimer(signal.ITIMER_PROF, 0)
        rss_mib = peak_rss_mib() or 0.0
        if rss_mib > MAX_RSS_MIB:
            problem = problem or f"{rss_mib:.0f} MiB"
        send.send((code, due, rss_mib, problem))
