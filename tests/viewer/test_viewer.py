"""The viewer takes what a replay gives it, and costs nothing where nobody looks."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from tests.helpers.places import ROOM
from tests.helpers.wall import Wall, camera_path, rig

rr = pytest.importorskip("rerun")


def _run(rrd, compressed: bool, places=None):
    engine, truth = sfm.Engine(rig()), sfm.Trajectory(np.array([1]), np.eye(4)[None])
    viewer = sfm.open_viewer(rig(), rrd, ground_truth=truth)
    for frame in Wall(3).frames(rig(), camera_path(4)):
        if compressed:
            frame = replace(
                frame, pictures=tuple(cv2.imencode(".png", image)[1].tobytes() for image in frame.images)
            )
        viewer.write(engine.step(frame), frame)
    if places is not None:
        viewer.show_map(places)
    viewer.close()


def _verified_pieces(rrd) -> dict[str, int]:
    """In how many pieces each entity of a recording is stored, which Rerun's own tool takes for whole."""
    tool = [sys.executable, "-m", "rerun", "rrd"]
    for command in ("verify", "stats"):
        done = subprocess.run([*tool, command, rrd], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    return {path: int(count) for path, count in re.findall(r"^/(\S+): (\d+)$", done.stdout, re.MULTILINE)}


@pytest.mark.parametrize("compressed", [True, False])
def test_a_recording_verifies(tmp_path, compressed):
    path = tmp_path / "run.rrd"
    _run(path, compressed)
    _verified_pieces(path)
    data = path.read_bytes()
    # recorded bytes are handed on; raw ones, of live cameras, become JPEG, a third of the size or less
    assert (b"image/png" if compressed else b"image/jpeg") in data
    assert b"local_structure" in data and b"position_3_sigma" in data


def test_a_map_is_shown_before_and_after_its_loops(tmp_path):
    class Places:
        def lines(self):
            way = np.arange(9.0).reshape(3, 3)
            return way, way + 0.1, np.array([[0, 2]])

    path = tmp_path / "run.rrd"
    _run(path, True, Places())
    expected = {f"world/places/{when}/{what}" for when in ("before", "after") for what in ("way", "loops")}
    assert expected <= _verified_pieces(path).keys()


def test_the_recording_of_the_sample_log_is_written_in_few_pieces(tmp_path, cli):
    rrd = tmp_path / "room.rrd"
    cli("replay", ROOM, "--max-frames", 12, "--out", tmp_path / "out", "--rrd", rrd, "-q")
    pieces = _verified_pieces(rrd)
    of_frames = [count for path, count in pieces.items() if path.startswith(("world", "drift", "tracks"))]
    assert len(of_frames) > 8 and max(of_frames) <= 2  # what does not change, and all frames


def test_without_a_file_or_window_there_is_no_viewer():
    with pytest.raises(sfm.ConfigError, match="file to write"):
        sfm.open_viewer(rig())


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(sfm.OutputError, match="nowhere"):
        sfm.open_viewer(rig(), tmp_path / "nowhere" / "run.rrd")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_full_disk_neither_holds_up_the_run_nor_hides(capfd):
    with pytest.raises(sfm.OutputError, match="/dev/full is incomplete: No space left on device"):
        _run("/dev/full", compressed=False)
    assert capfd.readouterr().err == "", "Rerun says nothing itself"
