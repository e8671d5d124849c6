"""Images of the largest accepted size are replayed, and made into a surface, within a gigabyte."""

from pathlib import Path

import cv2
import numpy as np
import pytest

import stream_sfm as sfm
from stream_sfm.camera.models import MAX_PIXELS
from tests.helpers.memory import peaks_mib
from tests.helpers.stereo_logs import PERIOD_NS, START_NS, Calib, LogWriter, write_pair

_WIDTH, _HEIGHT = 4096, 3050
_COMMANDS = """
from stream_sfm.cli.main import main
log, out = sys.argv[1:]
assert main(["replay", log, "--out", out]) == 0
peak()
assert main(["surface", log, "--all", "--out", out + ".ply"]) == 0
"""


def write_raw(path: Path, width: int, height: int, encoding: str, frames: int = 2) -> Path:
    """A textured wall that moves sideways, through lenses with distortion, in raw images."""
    texture = np.random.default_rng(0).integers(0, 255, (height // 8 + 8, width // 8 + 40), np.uint8)
    wall = cv2.resize(texture, None, fx=8, fy=8, interpolation=cv2.INTER_CUBIC)
    k = np.array([[0.8 * width, 0, width / 2], [0, 0.8 * width, height / 2], [0, 0, 1]])
    projections = [np.c_[k, [-baseline_m * k[0, 0], 0, 0]] for baseline_m in (0, 0.3)]
    infos = [Calib(width, height, D=(-0.05, 0.01, 0, 0, 0), K=k, P=p) for p in projections]
    log = LogWriter(path, chunk_size=1000)
    for n in range(frames):
        images = [wall[:height, start : start + width] for start in (4 * n, 4 * n + width // 40)]
        write_pair(log, "foxglove", START_NS + n * PERIOD_NS, images, infos if n == 0 else None, encoding)
    log.close()
    return path


@pytest.mark.slow
def test_the_largest_images_take_less_than_a_gigabyte(tmp_path):
    """Two frames of 16 bits, replayed and then made a surface, in one process."""
    assert 0.99 * MAX_PIXELS < _WIDTH * _HEIGHT <= MAX_PIXELS
    log = write_raw(tmp_path / "log.mcap", _WIDTH, _HEIGHT, "mono16")
    assert max(peaks_mib(_COMMANDS, log, tmp_path / "out")) < 1024


def test_raw_images_of_too_many_bytes_are_refused_with_the_limit(tmp_path):
    log = write_raw(tmp_path / "log.mcap", 3000, 2900, "rgba8", frames=1)
    with pytest.raises(sfm.LogError, match=r"raw images of 33 MiB are not read, only those of up to 32 MiB"):
        list(sfm.open_log(log).frames())


def test_images_that_are_not_prepared_ahead_give_the_same(tmp_path, monkeypatch):
    log = write_raw(tmp_path / "log.mcap", 320, 240, "mono8", frames=5)
    ahead = sfm.replay(log, None).trajectory.world_from_cam
    for module in ("logs.recording.frames", "run.ahead"):
        monkeypatch.setattr(f"stream_sfm.{module}.MANY_PIXELS", 1)
    np.testing.assert_array_equal(sfm.replay(log, None).trajectory.world_from_cam, ahead)
