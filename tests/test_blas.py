"""The bytes of the estimates do not depend on the number of threads that the environment allows libraries."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from threadpoolctl import ThreadpoolController, threadpool_limits

from stream_sfm.system.blas import OneThread
from tests.helpers.places import ROOM

_PROGRAM = """
import hashlib, itertools, sys
import stream_sfm as sfm
log, digest = sfm.open_log(sys.argv[1]), hashlib.sha256()
for method in ("cross-frame", "ekf"):
    engine = sfm.Engine(log.rig, sfm.Config(method=method))
    for frame in itertools.islice(log.frames(), 5):
        e = engine.step(frame)
        for array in (e.world_from_cam, e.cov_pose, e.points_in_cam, e.cov_points, e.window_world_from_cam):
            digest.update(array.tobytes())
    print(method, digest.hexdigest())
sfm.replay(sys.argv[1], sys.argv[2], selection=sfm.Selection(max_frames=5))
for estimate in sfm.read_estimates(sys.argv[2] + "/estimates.mcap"):
    for array in (estimate.world_from_cam, estimate.cov_pose, estimate.window_world_from_cam):
        digest.update(array.tobytes())
print(digest.hexdigest())
"""


def printed(threads: int, out: Path) -> str:
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
    environment = {**os.environ, **dict.fromkeys(names, str(threads))}
    command = [sys.executable, "-c", _PROGRAM, str(ROOM), str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1800, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_live_and_replayed_estimates_do_not_depend_on_the_number_of_threads(tmp_path: Path) -> None:
    one, two = (printed(threads, tmp_path / str(threads)) for threads in (1, 2))
    assert one == two and one.count("\n") == 3


def blas_threads() -> set[int]:
    return {pool["num_threads"] for pool in ThreadpoolController().info() if pool["user_api"] == "blas"}


def test_the_number_is_restored_when_the_last_thread_leaves() -> None:
    scipy.linalg.inv(np.linalg.inv(np.eye(3)))  # each loads its library
    one_thread, inside, leave = OneThread(), threading.Event(), threading.Event()

    def stay() -> None:
        with one_thread:
            inside.set()
            assert leave.wait(30)

    with threadpool_limits(2, user_api="blas"):
        other = threading.Thread(target=stay)
        with one_thread:
            other.start()
            assert inside.wait(30)
            assert blas_threads() == {1}
        assert blas_threads() == {1}
        leave.set()
        other.join()
        assert blas_threads() == {2}
        with pytest.raises(ZeroDivisionError), one_thread:
            raise ZeroDivisionError
        assert blas_threads() == {2}


_COMMAND = """
from stream_sfm.cli.process import settle
settle()
import scipy.linalg
from threadpoolctl import ThreadpoolController
from stream_sfm.system.blas import one_thread
with one_thread:
    print(one_thread.begun_so, {p["num_threads"] for p in ThreadpoolController().info() if p["user_api"] == "blas"})
"""


@pytest.mark.parametrize(("given", "expected"), [("", "True {1}"), ("2", "False {1}")])
def test_a_command_computes_in_one_thread_whatever_the_environment_says(given: str, expected: str) -> None:
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": given}
    done = subprocess.run([sys.executable, "-c", _COMMAND], capture_output=True, text=True, env=environment)
    assert done.stdout.strip() == expected, done.stderr
