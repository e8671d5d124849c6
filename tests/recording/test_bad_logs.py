"""Damaged logs give everything intact; the error about an unusable log says what to do."""

import numpy as np
import pytest

from stream_sfm import LogError, open_log
from stream_sfm.inspection.overview import inspect_log
from tests.helpers.stereo_logs import Calib, Spec, right_calib, video, write_log


def log_of(**spec):
    return lambda path: write_log(path, Spec(**spec))


BAD: dict[str, tuple] = {
    "no such file": (lambda p: None, ["cannot read"]),
    "empty": (lambda p: p.write_bytes(b""), ["empty (0 bytes)"]),
    "not mcap": (lambda p: p.write_bytes(b"hello world, no log"), ["not a recording", "ROS 2 bag"]),
    "a bag": (lambda p: p.write_bytes(b"#ROSBAG V1.2\n"), ["another version", "rosbag migrate"]),
    "cut in the header": (lambda p: p.write_bytes(write_log(p).read_bytes()[:20]), ["no message"]),
    "header only": (lambda p: p.write_bytes(b"\x89MCAP0\r\n"), ["no message"]),
    "no images": (log_of(left=(), right=()), ["holds no"]),
    "one camera": (log_of(right=()), ["one camera only", "/camera/left/image"]),
    "unnamed sides": (log_of(topics=("/a", "/b")), ["which is the left and which the right", "/a, /b"]),
    "no calibration": (log_of(infos=(None, None)), ["/camera/left/image", "give the calibration"]),
    "half a calibration": (log_of(infos=(Calib(), None)), ["/camera/right/image", "give the calibration"]),
    "no P": (log_of(infos=(Calib(), Calib(P=np.zeros((3, 4))))), ["/camera/right/calibration", "P"]),
    "no baseline": (log_of(infos=(Calib(), Calib())), ["baseline", "/camera/right/calibration"]),
    "wrong sign": (log_of(infos=(right_calib(), Calib())), ["sign of P[3]", "swapped"]),
    "no rotation": (log_of(infos=(Calib(R=2 * np.eye(3)), right_calib())), ["R is not a rotation"]),
    "model": (log_of(infos=(Calib(model="mei", D=(1.0,)), right_calib())), ["'mei'", "supported"]),
    "other size": (log_of(size=(48, 32)), ["48×32", "96×64", "/camera/left/image"]),
    "encoding": (log_of(encoding="32FC1"), ["'32FC1'", "/camera/left/image", "mono8"]),
    "video": (video, ["compressed video", "/camera/left/image", "jpeg"]),
    "never in pairs": (
        log_of(left=(0, 1, 2, 3), right=(8, 9, 10, 11)), ["no stereo pair", "half a frame"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_named_with_its_remedy(path, name):
    make, words = BAD[name]
    make(path)
    with pytest.raises(LogError) as caught:
        list(open_log(path).frames())
    for word in (*words, str(path)):
        assert word in str(caught.value)


@pytest.mark.parametrize("name", [n for n in BAD if n not in ("no such file", "empty", "not mcap", "a bag")])
def test_inspection_names_what_replay_refuses(path, name):
    make, words = BAD[name]
    make(path)
    problems = " ".join(inspect_log(path)["problems"])
    assert problems
    if name != "encoding":
        assert words[0] in problems
