"""A Dask cluster gives what this machine gives."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from stream_sfm.executors import cluster
from stream_sfm.simulation.measure import Method, measure
from stream_sfm.simulation.scenes import Scene
from stream_sfm.simulation.trials import run_trials, stacked
from tests.batch.running import GOOD, NEEDS_PROC, batch, outcomes
from tests.helpers.same_results import assert_same_results

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def dask_address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A scheduler and a worker on this machine, started as the README says."""
    pytest.importorskip("distributed", reason="Dask is not installed (extra `cluster`): no cluster is tried")
    folder = tmp_path_factory.mktemp("dask")
    contact = folder / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    scheduler = ["scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(contact)]
    worker = ["worker", "--scheduler-file", str(contact), "--no-nanny", "--nthreads", "1"]
    running = []
    try:
        for command in (scheduler, [*worker, "--local-directory", str(folder)]):
            running.append(subprocess.Popen([*dask, *command, "--no-dashboard"], stderr=subprocess.DEVNULL))
        deadline = time.monotonic() + 600  # ends only what hangs
        while not contact.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        yield json.loads(contact.read_text())["address"]
    finally:
        for process in reversed(running):
            process.terminate()
            process.wait(60)


@NEEDS_PROC
def test_a_cluster_gives_the_same_bytes(first: Any, logs: Path, tmp_path: Path, dask_address: str) -> None:
    out, found, _ = first
    names = [*GOOD[:1], "corrupt"]
    assert batch(*(logs / f"{name}.mcap" for name in names), "--out", tmp_path, "--scheduler", dask_address) == 3
    there = outcomes(tmp_path)
    for name in GOOD[:1]:
        assert there[name]["status"] == "done"
        assert there[name]["key"] == found[name]["key"]
        assert_same_results(tmp_path / name, out / name)
    assert there["corrupt"]["reason"] == found["corrupt"]["reason"]


def test_trials_are_the_same_here_and_on_a_cluster(dask_address: str) -> None:
    methods = (Method("cross-frame"), Method("ekf"))
    job = partial(measure, scene=Scene(frames=6, track_length=4), methods=methods, frames=(3, 5))
    here = stacked(run_trials(job, 2, seed=5))
    with cluster(dask_address) as pool:
        there = stacked(run_trials(job, 2, seed=5, executor=pool))
    for label, entry in here.items():
        for quantity, values in entry.items():
            assert values.tobytes() == there[label][quantity].tobytes(), (label, quantity)


def test_a_scheduler_that_is_not_there_is_2(logs: Path, tmp_path: Path, monkeypatch: Any, capsys: Any) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed (extra `cluster`)")
    monkeypatch.setattr("stream_sfm.executors._ANSWER_S", 0.2)
    for address, said in (
        ("tcp://127.0.0.1:9", "no Dask scheduler answers at tcp://127.0.0.1:9"),
        ("127.0.0.1", "write it as in tcp://127.0.0.1:8786"),
    ):
        assert batch(logs / "good0.mcap", "--out", tmp_path / "o", "--scheduler", address) == 2
        assert said in capsys.readouterr().err
