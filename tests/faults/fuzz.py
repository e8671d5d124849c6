"""Hostile inputs through the command line, in a worker that may hang, swell or die without taking the test along."""

import contextlib
import multiprocessing
import os
import signal
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

from stream_sfm.run.summary import peak_rss_mib

MAX_WAIT_S = 120  # of waiting for nothing
MAX_RSS_MIB = 1024

Trial = Callable[[int], tuple[int, str]]  # seed -> exit code, what is wrong


@dataclass
class Outcome:
    """What so many inputs came to. `failures`: seed -> what went wrong; `exit_codes` of the others."""

    tried: int = 0
    failures: dict[int, str] = field(default_factory=dict)
    exit_codes: Counter[int] = field(default_factory=Counter)
    peak_rss_mib: float = 0.0


def fuzz(prepare: Callable[[Path], Trial], first: int, count: int, folder: Path, max_cpu_seconds: float) -> Outcome:
    """Run the trial that `prepare` makes for the seeds `first` … `first + count − 1`.

    A seed that kills the worker is a failure; a new worker goes on with the next. `prepare` must be picklable.
    """
    outcome = Outcome()
    at, end = first, first + count
    server = multiprocessing.get_context("forkserver")  # not a fork of this one: its memory is to be its own
    server.set_forkserver_preload(["tests.faults.attacks"])  # with everything imported
    while at < end:
        receive, send = server.Pipe(duplex=False)
        worker = server.Process(target=_work, args=(send, prepare, at, end, folder, max_cpu_seconds))
        worker.start()
        send.close()
        with receive, contextlib.suppress(EOFError):
            while True:
                code, rss_mib, problem = receive.recv()
                outcome.peak_rss_mib = max(outcome.peak_rss_mib, rss_mib)
                if problem:
                    outcome.failures[at] = problem
                else:
                    outcome.exit_codes[code] += 1
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
    send: Connection, prepare: Callable[[Path], Trial], first: int, end: int, folder: Path, max_cpu_seconds: float
) -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # image libraries write there what they think of damaged images
    trial = prepare(folder)
    for seed in range(first, end):
        # The default of both signals ends the process, also inside a library that does not come back.
        signal.setitimer(signal.ITIMER_PROF, max_cpu_seconds)
        signal.alarm(MAX_WAIT_S)
        code, problem = trial(seed)
        signal.setitimer(signal.ITIMER_PROF, 0)
        rss_mib = peak_rss_mib() or 0.0
        if rss_mib > MAX_RSS_MIB:
            problem = problem or f"{rss_mib:.0f} MiB"
        send.send((code, rss_mib, problem))
