"""The viewer takes the data of a replay, and its window is really started, on this computer only."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from tests.helpers.imu_log import write_imu_log
from tests.helpers.places import ROOM
from tests.helpers.wall import Wall, camera_path, rig

pytest.importorskip("rerun")
PATIENCE_S = 600  # ends only what hangs


def _run(rrd, compressed: bool, places=None):
    engine, truth = sfm.Engine(rig()), sfm.Trajectory(np.array([1]), np.eye(4)[None])
    viewer = sfm.open_viewer(rig(), rrd, ground_truth=truth)
    for frame in Wall(3).frames(rig(), camera_path(4)):
        if compressed:
            frame = replace(frame, pictures=tuple(cv2.imencode(".png", image)[1].tobytes() for image in frame.images))
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


class _Places:
    def lines(self):
        way = np.arange(9.0).reshape(3, 3)
        return way, way + 0.1, np.array([[0, 2]])


@pytest.mark.parametrize("compressed", [True, False])
def test_a_recording_verifies(tmp_path, compressed):
    """And has a map before and after its loops, if there is one."""
    path = tmp_path / "run.rrd"
    _run(path, compressed, _Places() if compressed else None)
    pieces = _verified_pieces(path)
    of_map = (pieces[f"world/places/{when}/{what}"] for when in ("before", "after") for what in ("way", "loops"))
    assert set(of_map) == {1 + compressed}  # the style, and what is shown
    data = path.read_bytes()
    # recorded bytes are handed on; raw ones, of live cameras, become JPEG, a third of the size or less
    assert (b"image/png" if compressed else b"image/jpeg") in data
    assert b"local_structure" in data and b"position_3_sigma" in data


def test_gravity_and_velocity_are_arrows_at_the_camera(tmp_path, cli):
    rrd, (log, plain, _) = tmp_path / "imu.rrd", write_imu_log(tmp_path)
    arrows = {"world/camera/gravity", "world/camera/velocity"}
    cli("replay", log, "--out", tmp_path / "out", "--rrd", rrd, "-q")
    assert arrows <= {path for path, count in _verified_pieces(rrd).items() if count == 2}  # style and frames
    assert sfm.read_results(tmp_path / "out").summary["imu"]["frames"] > 0
    cli("replay", plain, "--out", tmp_path / "plain", "--rrd", rrd, "-q")
    assert all(count == 1 for path, count in _verified_pieces(rrd).items() if path in arrows)  # the style alone


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


@pytest.fixture
def display(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A virtual display."""
    if shutil.which("Xvfb") is None:
        pytest.skip("needs Xvfb")
    number, told = os.pipe()
    command = ["Xvfb", "-displayfd", str(told), "-screen", "0", "1280x800x24"]
    with subprocess.Popen(command, pass_fds=(told,), stderr=subprocess.DEVNULL) as server:
        os.close(told)
        with open(number) as answer:
            monkeypatch.setenv("DISPLAY", f":{answer.readline().strip()}")
        yield
        server.terminate()


def eventually(attempt: Callable[[], object]) -> object:
    """What `attempt` returns once it raises no error and returns something."""
    end_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            if found := attempt():
                return found
        except Exception:
            if time.monotonic() > end_s:
                raise
        assert time.monotonic() < end_s
        time.sleep(0.2)


@pytest.mark.slow
def test_a_window_shows_the_frames_and_may_be_closed_before_the_run_ends(display: None, tmp_path: Path) -> None:
    client = pytest.importorskip("rerun.experimental").ViewerClient
    log = sfm.open_log(ROOM)
    engine, viewer = sfm.Engine(log.rig), sfm.open_viewer(log.rig, view=True)
    recording, frames = viewer._recording, log.frames(sfm.Selection(max_frames=5))
    try:
        for frame in islice(frames, 4):
            viewer.write(engine.step(frame), frame)
        port = int(recording.url.split(":")[2].split("/")[0])
        listening = [line.split()[1] for line in Path("/proc/net/tcp").read_text().splitlines() if " 0A " in line]
        assert f"0100007F:{port:04X}" in listening, "127.0.0.1, no other address"
        shown = eventually(lambda: client(recording.url).get_state().active_recording)
        assert "stream_sfm" in str(shown)
        picture = tmp_path / "window.png"
        eventually(lambda: client(recording.url).save_screenshot(str(picture)) or picture.exists())
        assert cv2.imread(str(picture)).std() > 5, "a window without views is of one colour"
    finally:
        os.killpg(recording.viewer.pid, signal.SIGKILL)
        recording.viewer.wait(PATIENCE_S)
    frame = next(frames)
    viewer.write(engine.step(frame), frame)
    viewer.close()


@pytest.mark.parametrize("empty", [False, True])
def test_a_window_needs_a_display(empty, monkeypatch):
    if not sys.platform.startswith("linux"):
        pytest.skip("only Linux names the display in environment variables")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
        if empty:
            monkeypatch.setenv(name, "")
    with pytest.raises(sfm.ConfigError, match="no display"):
        sfm.open_viewer(sfm.open_log(ROOM).rig, view=True)
