"""Every profile, image encoding and way of giving the calibration replays to the same trajectory.

The reference is the live engine on the very images: for lossy encodings on what OpenCV makes of the bytes, so that
no tolerance has to cover the loss. Reading adds nothing then: images and rig are the same to the last bit, and so
are the trajectories. The lenses, for which geometry matters, have tests of their own with the default method.
"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from stream_sfm import Config, Engine, StereoFrame, StereoRig, replay
from stream_sfm.config import read_config
from stream_sfm.geometry import se3
from stream_sfm.logs.mcap_file.log_file import LogFile
from stream_sfm.logs.mcap_file.message import Damage
from stream_sfm.results.estimates_writer import EstimatesWriter
from tests.helpers.stereo_logs import PERIOD_NS, START_NS, LogWriter, encode, infos_of, write_pair, write_transform
from tests.helpers.wall import Wall, camera_path, rig

SIZE, FRAMES = (160, 120), 3
QUICK = read_config(None, ['method="frame-to-frame"', "frontend.max_tracks=60"])
ROUNDING = 1e-12

PROFILES = ("foxglove", "json", "ros2", "ros2idl", "ros1")
ENCODINGS = (
    "png", "jpeg", "webp", "mono8", "mono8-padded", "mono16", "mono16-be", "rgb8", "bgr8-padded", "rgba8", "bgra8",
    "bayer_rggb8", "bayer_bggr8", "bayer_gbrg8", "bayer_grbg8", "uyvy", "yuv422_yuy2", "nv12",
)  # fmt: skip
CALIBRATIONS = ("once", "often", "late", "attached", "attached by a run", "file", "transform")


def combinations():
    """Every encoding by Foxglove and by ROS, some in the other profiles, and every calibration in every profile.

    Profiles, images and calibrations are read apart from each other, so that not all of them need meet: each encoding
    comes with one calibration, by turns.
    """
    for profile in PROFILES:
        # Foxglove's RawImage is little-endian
        encodings = [e for e in ENCODINGS if e != "mono16-be" or profile.startswith("ros")]
        encodings = encodings if profile in ("foxglove", "ros2") else encodings[::4]
        yield from ((profile, e, CALIBRATIONS[n % len(CALIBRATIONS)]) for n, e in enumerate(encodings))
        yield from ((profile, "mono8", calibration) for calibration in CALIBRATIONS)


@pytest.fixture(scope="module")
def recorded():
    """The rig and the frames."""
    wall, stereo = Wall(5), rig(width=SIZE[0], height=SIZE[1])
    return stereo, wall.frames(stereo, camera_path(FRAMES))


@pytest.fixture(scope="module")
def live(recorded):
    """encoding -> the poses (n, 4, 4) that the live engine finds for images that went through it."""
    stereo, frames = recorded
    frames = [replace(f, stamp_ns=START_NS + i * PERIOD_NS) for i, f in enumerate(frames)]  # those of the logs
    known: dict[str, np.ndarray] = {}

    def poses(encoding: str) -> np.ndarray:
        if encoding not in known:
            known[encoding] = run_live(stereo, [degraded(f, encoding) for f in frames], QUICK)
        return known[encoding]

    return poses


def degraded(frame: StereoFrame, encoding: str) -> StereoFrame:
    """What remains of a frame by OpenCV's own reading of the bytes; the frame itself where nothing is lost."""
    if encoding in ("jpeg", "webp"):
        return replace(frame, **{s: cv2.imdecode(np.frombuffer(encode(getattr(frame, s), encoding)[0], np.uint8), 0)
                                 for s in ("left", "right")})  # fmt: skip
    if encoding.startswith("bayer"):
        code = getattr(cv2, f"COLOR_Bayer{encoding[6:10].upper()}2GRAY")
        return replace(frame, left=cv2.cvtColor(frame.left, code), right=cv2.cvtColor(frame.right, code))
    return frame


def run_live(stereo: StereoRig, frames: list[StereoFrame], config: Config) -> np.ndarray:
    engine = Engine(stereo, config)
    return np.stack([engine.step(frame).world_from_cam for frame in frames])


def write(file: Path, recorded, profile: str, encoding: str, calibration: str) -> Path:
    stereo, frames = recorded
    log = LogWriter(file)
    sent_at = {"once": (0,), "often": range(FRAMES), "late": (FRAMES - 1,), "transform": (0,)}.get(calibration, ())
    if calibration == "attached":
        log.writer.add_attachment(0, 0, "calibration.toml", "application/toml", stereo.to_toml().encode())
    if calibration == "attached by a run":
        EstimatesWriter(file.with_name("estimates.mcap"), stereo, Config()).close()
        (attachment,) = LogFile(file.with_name("estimates.mcap")).attachments(Damage())
        log.writer.add_attachment(0, 0, attachment.name, attachment.media_type, attachment.data)
    if calibration == "transform":
        write_transform(log, profile, START_NS, "left", "right", se3.inverse(stereo.right_from_left))
    sent = infos_of(stereo, 0.0 if calibration == "transform" else None)
    for i, frame in enumerate(frames):
        infos = sent if i in sent_at else None
        write_pair(log, profile, START_NS + i * PERIOD_NS, (frame.left, frame.right), infos, encoding)
    log.close()
    return file


@pytest.mark.parametrize(("profile", "encoding", "calibration"), sorted(set(combinations())))
def test_every_combination_replays_to_one_trajectory(tmp_path, recorded, live, profile, encoding, calibration):
    file = write(tmp_path / "log.mcap", recorded, profile, encoding, calibration)
    outside = None
    if calibration == "file":
        outside = tmp_path / "c.toml"
        outside.write_text(recorded[0].to_toml())
    result = replay(file, config=QUICK, calibration=outside)
    assert result.summary["complete"] and not result.summary["warnings"]
    assert result.summary["frames"]["estimated"] == FRAMES and result.summary["frames"]["lost"] == 0
    np.testing.assert_allclose(result.trajectory.world_from_cam, live(encoding), atol=ROUNDING)
    assert np.abs(result.trajectory.world_from_cam - camera_path(FRAMES)).max() < 0.01  # and it is the true one
