"""However a run ends, its estimates can be read: killed at any moment, on a full disk, in a read-only folder."""

import multiprocessing
import os
import random
import resource
import subprocess
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.cli.main import main
from stream_sfm.logs.sources.pose_files import read_tum
from stream_sfm.results.estimates_reader import read_estimates
from stream_sfm.run.replay import replay
from stream_sfm.system.outputs import RESULTS
from tests.helpers.wall_log import write_wall_log

FAST = sfm.Config(method="frame-to-frame")
FRAMES = 60
IN_A_SECOND = 20


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return write_wall_log(tmp_path_factory.mktemp("logs") / "wall.mcap", n=16, times=4, truth=False)


@pytest.fixture(scope="module")
def whole(log):
    trajectory = replay(log, None, FAST).trajectory
    assert len(trajectory) == FRAMES
    return trajectory


@pytest.fixture(scope="module")
def processes():
    """Processes that start with everything imported."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tests.faults.test_ended_runs"])
    yield context


def _replay_and_tell(log: Path, out: Path, told: Connection) -> None:
    replay(log, out, FAST, sinks=[Mock(write=lambda estimate, _: told.send(estimate.frame_index))])


def _replay_on_a_small_disk(log: Path, out: Path, size: int, said: Path) -> None:
    os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT), 2)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))  # as a full disk: write() refuses
    os._exit(main(["replay", str(log), "--out", str(out), "-q", "--method", "frame-to-frame"]))


def same_as_whole(path: Path, whole: sfm.Trajectory) -> int:
    """The number of estimates in a file, which are the first ones of the whole run."""
    records = list(read_estimates(path))
    assert [r.frame_index for r in records] == list(range(len(records)))
    for record, pose in zip(records, whole.world_from_cam, strict=False):
        assert np.array_equal(record.world_from_cam, pose)
    return len(records)


@pytest.mark.slow
def test_kills_cost_a_second_each(log, whole, processes, tmp_path):
    rng = random.Random(5)
    out = tmp_path / "out"
    for until in [*rng.sample(range(1, FRAMES), 2), FRAMES - 1]:
        receive, send = processes.Pipe(duplex=False)
        process = processes.Process(target=_replay_and_tell, args=(log, out, send))
        process.start()
        send.close()
        told = -1
        while told < until:
            told = receive.recv()
        time.sleep(rng.uniform(0, 0.02))
        process.kill()
        process.join()
        try:
            while True:
                told = receive.recv()
        except EOFError:
            receive.close()
        finished = (out / "summary.json").exists()
        folder = [p for p in (out / "estimates.mcap.part", out / "estimates.mcap") if p.exists()]
        count = same_as_whole(folder[0], whole)
        assert count >= told + 1 - IN_A_SECOND or finished
        for path in out.iterdir():
            path.unlink()
    again = replay(log, out, FAST)
    assert sorted(p.name for p in out.iterdir()) == sorted(RESULTS)
    written = sfm.read_results(out)
    assert len(written) == len(whole) == len(again.trajectory) and not written.warnings


@pytest.mark.parametrize("size", [2_000, 20_000, 60_000, 250_000])
def test_a_full_disk_keeps_what_was_written_and_says_where(size, log, whole, processes, tmp_path):
    out, said = tmp_path / "out", tmp_path / "said"
    process = processes.Process(target=_replay_on_a_small_disk, args=(log, out, size, said))
    process.start()
    process.join()
    message = said.read_text()
    assert process.exitcode == 3, message
    assert "Traceback" not in message and "cannot write" in message and ".part" in message
    assert not (out / "estimates.mcap").exists()  # what has a gap or an open end keeps its temporary name
    if size > 30_000:
        count = same_as_whole(out / "estimates.mcap.part", whole)
        of_path = len(read_tum(out / "trajectory.tum"))
        assert count <= of_path < len(whole) and 2 * count >= of_path - 1  # a chunk is as long as all before it


def test_a_folder_that_takes_no_files_is_named(log, tmp_path, cli):
    (tmp_path / "estimates.mcap.part").mkdir()  # a folder in its place: also root is refused
    assert str(tmp_path / "estimates.mcap") in cli("replay", log, "--out", tmp_path, "-q", code=3).err


def test_a_name_that_is_not_text_is_refused(log, tmp_path, cli):
    odd = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff.mcap"))
    odd.write_bytes(log.read_bytes())
    assert "not UTF-8" in cli("replay", odd, "--out", tmp_path / "out", code=3).err


def test_a_terminal_with_ascii_only_is_not_a_defect(log, tmp_path):
    command = [sys.executable, "-m", "stream_sfm", "replay", str(log), "--out", str(tmp_path), "--max-frames", "3"]
    done = subprocess.run(command, capture_output=True, env=os.environ | {"PYTHONIOENCODING": "ascii:strict"})
    assert done.returncode == 0, done.stderr
