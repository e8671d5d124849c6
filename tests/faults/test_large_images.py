"""Images of the largest size that is accepted are replayed, and shown as a surface, within a gigabyte."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

import stream_sfm as sfm
from stream_sfm.camera.models import MAX_PIXELS
from tests.helpers.memory import peaks_mib
from tests.helpers.stereo_logs import PERIOD_NS, START_NS, LogWriter, Spec

_WIDTH, _HEIGHT = 4096, 3050
_COMMANDS = """
from stream_sfm.cli.main import main
log, out = sys.argv[1:]
assert main(["replay", log, "--out", out]) == 0
peak()
assert main(["surface", log, "--all", "--out", out + ".ply"]) == 0
"""


def write_raw(path: Path, width: int, height: int, encoding: str, channels: int, frames: int = 2) -> Path:
    """A textured wall that moves sideways, through lenses with distortion, in raw images."""
    texture = np.random.default_rng(0).integers(0, 255, (height // 8 + 8, width // 8 + 40), np.uint8)
    wall = cv2.resize(texture, None, fx=8, fy=8, interpolation=cv2.INTER_CUBIC)
    f, deep = 0.8 * width, encoding.endswith("16")
    log = LogWriter(path, chunk_size=1000)
    for n in range(frames):
        time_ns = START_NS + n * PERIOD_NS
        for side, (topic, info) in enumerate(zip(Spec.topics, Spec.info_topics, strict=True)):
            if n == 0:
                k = [f, 0, width / 2, 0, f, height / 2, 0, 0, 1]
                calibration = CameraCalibration(
                    width=width, height=height, distortion_model="plumb_bob", D=[-0.05, 0.01, 0, 0, 0], K=k,
                    R=np.eye(3).ravel(), P=[f, 0, k[2], -0.3 * f * side, 0, f, k[5], 0, 0, 0, 1, 0],
                )  # fmt: skip
                calibration.timestamp.FromNanoseconds(time_ns)
                log.protobuf(info, calibration, time_ns)
            start = 4 * n + (width // 40 if side else 0)
            pixels = wall[:height, start : start + width].astype(np.uint16 if deep else np.uint8)
            data = np.repeat(pixels[:, :, None], channels, axis=2) * (200 if deep else 1)
            image = RawImage(width=width, height=height, encoding=encoding, data=data.tobytes())
            image.step = width * channels * pixels.itemsize
            image.timestamp.FromNanoseconds(time_ns)
            log.protobuf(topic, image, time_ns)
    log.close()
    return path


@pytest.mark.slow
def test_the_largest_images_take_less_than_a_gigabyte(tmp_path):
    """Two frames of 16 bits, replayed and then made a surface, in one process."""
    assert 0.99 * MAX_PIXELS < _WIDTH * _HEIGHT <= MAX_PIXELS
    log = write_raw(tmp_path / "log.mcap", _WIDTH, _HEIGHT, "mono16", 1)
    assert max(peaks_mib(_COMMANDS, log, tmp_path / "out")) < 1024


def test_the_limits_are_named():
    k = np.array([[4000.0, 0, 2000], [0, 4000, 2000], [0, 0, 1]])
    with pytest.raises(sfm.ConfigError, match=r"at most 12\.5 megapixels; reduce larger images"):
        sfm.Camera(4096, 3052, k)


def test_raw_images_of_too_many_bytes_are_refused_with_the_limit(tmp_path):
    log = write_raw(tmp_path / "log.mcap", 2400, 1800, "rgba16", 4, frames=1)
    with pytest.raises(sfm.LogError, match=r"raw images of 33 MiB are not read, only those of up to 32 MiB"):
        list(sfm.open_log(log).frames())


def test_images_that_are_not_prepared_ahead_give_the_same(tmp_path, monkeypatch):
    log = write_raw(tmp_path / "log.mcap", 320, 240, "mono8", 1, frames=5)
    ahead = sfm.replay(log, None).trajectory.world_from_cam
    for module in ("recording.frames", "run.loop"):
        monkeypatch.setattr(f"stream_sfm.{module}.MANY_PIXELS", 1)
    np.testing.assert_array_equal(sfm.replay(log, None).trajectory.world_from_cam, ahead)
