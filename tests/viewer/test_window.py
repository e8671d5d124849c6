"""A viewer window is really started, on this computer only, and shows the run."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

import cv2
import pytest

import stream_sfm as sfm
from tests.helpers.places import ROOM

pytest.importorskip("rerun")
PATIENCE_S = 600  # ends only what hangs


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
