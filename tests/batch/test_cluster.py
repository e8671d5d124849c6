"""A Dask cluster gives the same results as this machine."""

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.batch.running import GOOD, NEEDS_PROC, batch, in_the_midst, meanwhile, outcomes
from tests.helpers.same_results import assert_same_results

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker may take as long to start as a loaded machine wants."""
    monkeypatch.setattr("stream_sfm.system.executors._WORKER_S", 600.0)
    monkeypatch.setattr("stream_sfm.system.executors._ANSWER_S", 600.0)


@contextmanager
def dask(folder: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler and a worker on this machine, started as the README says: its address, and the processes of both."""
    pytest.importorskip("distributed", reason="Dask is not installed (extra `cluster`): no cluster is tried")
    contact = folder / "scheduler.json"
    scheduler = ["scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(contact)]
    worker = ["worker", "--scheduler-file", str(contact), "--nthreads", "1", "--no-nanny"]
    worker += ["--local-directory", str(folder)]
    running: list[subprocess.Popen[bytes]] = []

    def start(*command: str) -> None:
        words = [sys.executable, "-m", "dask", *command, "--no-dashboard"]
        running.append(subprocess.Popen(words, stderr=subprocess.DEVNULL))

    try:
        start(*scheduler)
        deadline = time.monotonic() + 600  # ends only what hangs
        said = ""
        while not said.rstrip().endswith("}") and time.monotonic() < deadline:  # there, and wholly written
            time.sleep(0.05)
            said = contact.read_text() if contact.exists() else ""
        start(*worker)
        yield json.loads(said)["address"], running
    finally:
        for process in reversed(running):
            process.terminate()
            process.wait(60)


@NEEDS_PROC
def test_a_cluster_gives_the_same_bytes(first: Any, logs: Path, tmp_path: Path) -> None:
    out, found, _ = first
    names = [*GOOD[:1], "corrupt"]
    with dask(tmp_path) as (address, _):
        assert batch(*(logs / f"{name}.mcap" for name in names), "--out", tmp_path, "--scheduler", address) == 3
    there = outcomes(tmp_path)
    for name in GOOD[:1]:
        assert there[name]["status"] == "done"
        assert there[name]["key"] == found[name]["key"]
        assert_same_results(tmp_path / name, out / name)
    assert there["corrupt"]["reason"] == found["corrupt"]["reason"]


@NEEDS_PROC
@pytest.mark.parametrize(("which", "how"), [(1, signal.SIGKILL), (1, signal.SIGSTOP), (0, signal.SIGKILL)])
def test_the_end_of_the_last_worker_ends_the_batch(
    which: int, how: signal.Signals, logs: Path, tmp_path: Path, monkeypatch: Any, capfd: Any
) -> None:
    """With a worker that dies or stops in the midst of a log, or with the scheduler; Dask itself would wait."""
    monkeypatch.setattr("stream_sfm.system.executors._LOST_S", 6.0)
    with dask(tmp_path) as (address, processes):
        out = tmp_path / "out"
        with meanwhile(
            lambda: in_the_midst(logs / "victim.mcap", out / "victim") and processes[which].send_signal(how)
        ):
            assert batch(logs / "victim.mcap", "--out", out, "--scheduler", address) == 3
        processes[which].send_signal(signal.SIGCONT)
    assert outcomes(out)["victim"]["reason"].startswith(
        "the scheduler of the cluster, or its last worker, is gone or silent"
    )
    assert capfd.readouterr().err.count("\n") <= 2


def test_a_scheduler_that_is_not_there_is_2(logs: Path, tmp_path: Path, monkeypatch: Any, capsys: Any) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed (extra `cluster`)")
    monkeypatch.setattr("stream_sfm.system.executors._ANSWER_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        here = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        for address, said in (
            ("tcp://127.0.0.1:9", "no Dask scheduler answers at tcp://127.0.0.1:9"),
            (here, f"no Dask scheduler answers at {here} (not within 0.2 s)"),
            ("127.0.0.1", "write it as in tcp://127.0.0.1:8786"),
        ):
            assert batch(logs / "good0.mcap", "--out", tmp_path / "o", "--scheduler", address) == 2
            assert said in capsys.readouterr().err
