"""Damaged logs give all that is whole; logs that cannot be used are named with what to do."""

import struct

import numpy as np
import pytest
import zstandard

from stream_sfm import LogError, open_log
from stream_sfm.inspection import inspect_log
from tests.helpers.stereo_logs import CONTAINERS, Calib, Spec, right_calib, video, whole_messages, write_log


@pytest.mark.parametrize("share", [0.3, 0.5, 0.77, 0.95])
def test_a_cut_file_gives_all_that_is_whole(path, share):
    write_log(path, use_chunking=False)
    data = path.read_bytes()
    cut = int(share * len(data))
    cameras = {}
    for end, channel, time in whole_messages(path):
        if end <= cut:
            cameras.setdefault(channel, set()).add(time)
    # channels 3 and 4 are the images, by the order of writing
    whole = cameras.get(3, set()) & cameras.get(4, set())
    path.write_bytes(data[:cut])
    log = open_log(path)
    frames = list(log.frames())
    assert [f.stamp_ns for f in frames] == sorted(whole)
    assert not log.stats.complete
    assert "cut off" in log.stats.warnings[0] and str(path) in log.stats.warnings[0]
    assert f"{len(frames)} stereo frames" in log.stats.warnings[1]


def test_a_flipped_byte_costs_its_chunk_only(path):
    write_log(path, **CONTAINERS["zstd"])
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    log = open_log(path)
    assert 8 <= len(list(log.frames())) < 12
    assert not log.stats.complete and "damaged chunk" in log.stats.warnings[0]


def test_a_chunk_that_inflates_without_end_is_refused(path):
    write_log(path, Spec(), use_chunking=False)
    data = path.read_bytes()
    bomb = zstandard.compress(bytes(1 << 20))
    body = (
        struct.pack("<QQQI", 0, 0, 1 << 40, 0)
        + struct.pack("<I", 4)
        + b"zstd"
        + struct.pack("<Q", len(bomb))
        + bomb
    )
    at = 8 + 9 + struct.unpack_from("<Q", data, 9)[0]
    path.write_bytes(data[:at] + struct.pack("<BQ", 6, len(body)) + body + data[at:])
    log = open_log(path)
    assert len(list(log.frames())) == 12
    assert any("it declares" in warning for warning in log.stats.warnings)


def log_of(**spec):
    return lambda path: write_log(path, Spec(**spec))


BAD: dict[str, tuple] = {
    "no such file": (lambda p: None, ["cannot read"]),
    "empty": (lambda p: p.write_bytes(b""), ["empty (0 bytes)"]),
    "not mcap": (lambda p: p.write_bytes(b"hello world, no log"), ["not a recording", "ROS 2 bag"]),
    "a bag": (lambda p: p.write_bytes(b"#ROSBAG V1.2\n"), ["another version", "rosbag migrate"]),
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
