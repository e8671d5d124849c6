"""A batch run by a test, and the processes that it starts, which are found in /proc."""

import json
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from stream_sfm.cli.main import main

NEEDS_PROC = pytest.mark.skipif(not Path("/proc/self").exists(), reason="processes are found by way of /proc")
GOOD = [f"good{k}" for k in range(3)]


def process_of(log: Path) -> int | None:
    """The process that replays this log."""
    for found in Path("/proc").glob("[0-9]*"):
        try:
            words = (found / "cmdline").read_bytes().split(b"\0")
        except OSError:  # it has just ended
            continue
        if b"replay" in words and str(log).encode() in words:
            return int(found.name)
    return None


def in_the_midst(log: Path, out: Path) -> int | None:
    """The process that replays `log` once it has written a frame to `out`; None if it never does."""
    deadline = time.monotonic() + 600  # ends only what hangs
    while time.monotonic() < deadline:
        written = out / "trajectory.tum.part"
        if written.exists() and written.stat().st_size and (process := process_of(log)):
            return process
        time.sleep(0.01)
    return None


@contextmanager
def meanwhile(act: Callable[[], None]) -> Iterator[None]:
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(act)
        yield
    future.result()


def batch(*arguments: Any) -> int:
    return main(["batch", *map(str, arguments), "--quiet"])


def outcomes(out: Path) -> dict[str, dict[str, Any]]:
    return {log["name"]: log for log in json.loads((out / "batch.json").read_text())["logs"]}
