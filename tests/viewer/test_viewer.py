"""The viewer takes what a replay gives it, and costs nothing where nobody looks."""

import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.cli.main import main
from tests.helpers.places import ROOM

rr = pytest.importorskip("rerun")

LEFT = "world/camera/left"


def _rig() -> sfm.StereoRig:
    k = np.array([[100.0, 0, 64], [0, 100.0, 48], [0, 0, 1]])
    pose = np.eye(4)
    pose[0, 3] = -0.2
    return sfm.StereoRig(sfm.Camera(128, 96, k), sfm.Camera(128, 96, k), pose)


def _images(n: int) -> tuple[np.ndarray, np.ndarray]:
    wall = cv2.GaussianBlur(np.random.default_rng(3).integers(0, 256, (96, 300), dtype=np.uint8), (0, 0), 1.2)
    wall = cv2.normalize(wall, None, 0, 255, cv2.NORM_MINMAX)
    return tuple(np.ascontiguousarray(wall[:, s : s + 128]) for s in (20 + 2 * n, 30 + 2 * n))


def _run(rrd, compressed: bool, places=None):
    engine, truth = sfm.Engine(_rig()), sfm.Trajectory(np.array([1]), np.eye(4)[None])
    viewer = sfm.open_viewer(_rig(), rrd, ground_truth=truth)
    for n in range(4):
        left, right = _images(n)
        pictures = tuple(cv2.imencode(".png", i)[1].tobytes() for i in (left, right)) if compressed else ()
        frame = sfm.StereoFrame(1 + n * 10**8, left, right, pictures)
        viewer.write(engine.step(frame), frame)
    if places is not None:
        viewer.show_map(places)
    viewer.close()


def _verify(path):
    done = subprocess.run([sys.executable, "-m", "rerun", "rrd", "verify", path], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("compressed", [True, False])
def test_a_recording_verifies(tmp_path, compressed):
    path = tmp_path / "run.rrd"
    _run(path, compressed)
    _verify(path)
    data = path.read_bytes()
    # recorded bytes are handed on; raw ones, of live cameras, become JPEG, a third of the size or less
    assert (b"image/png" if compressed else b"image/jpeg") in data
    assert b"local_structure" in data and b"position_3_sigma" in data


def test_the_recording_of_the_sample_log_verifies(tmp_path):
    rrd = tmp_path / "room.rrd"
    arguments = ["--max-frames", "6", "--out", str(tmp_path / "out"), "--rrd", str(rrd), "-q"]
    assert main(["replay", str(ROOM), *arguments]) == 0
    _verify(rrd)


def test_a_map_is_shown_before_and_after_its_loops(tmp_path):
    class Places:
        def lines(self):
            way = np.arange(9.0).reshape(3, 3)
            return way, way + 0.1, np.array([[0, 2]])

    path = tmp_path / "run.rrd"
    _run(path, True, Places())
    _verify(path)
    stats = subprocess.run([sys.executable, "-m", "rerun", "rrd", "stats", path], capture_output=True, text=True)
    pieces = dict(re.findall(r"^/(\S+): (\d+)$", stats.stdout, re.MULTILINE))
    assert {f"world/places/{when}/{what}" for when in ("before", "after") for what in ("way", "loops")} <= {*pieces}


def test_a_recording_is_written_in_few_pieces(tmp_path):
    rrd = tmp_path / "room.rrd"
    arguments = ["--max-frames", "12", "--out", str(tmp_path / "out"), "--rrd", str(rrd), "-q"]
    assert main(["replay", str(ROOM), *arguments]) == 0
    command = [sys.executable, "-m", "rerun", "rrd", "stats", rrd]
    stats = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    pieces = dict(re.findall(r"^/(\S+): (\d+)$", stats, re.MULTILINE))
    of_frames = [int(count) for path, count in pieces.items() if path.startswith(("world", "drift", "tracks"))]
    assert len(of_frames) > 8 and max(of_frames) <= 2  # what does not change, and all frames


def test_without_a_file_or_window_there_is_no_viewer():
    with pytest.raises(sfm.ConfigError, match="file to write"):
        sfm.open_viewer(_rig())


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(sfm.OutputError, match="nowhere"):
        sfm.open_viewer(_rig(), tmp_path / "nowhere" / "run.rrd")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_full_disk_neither_holds_up_the_run_nor_hides(capfd):
    with pytest.raises(sfm.OutputError, match="/dev/full is incomplete: No space left on device"):
        _run("/dev/full", compressed=False)
    assert capfd.readouterr().err == "", "Rerun says nothing itself"
