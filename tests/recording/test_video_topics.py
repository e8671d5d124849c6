"""Logs whose cameras send H.264 or H.265: every frame that can be decoded, with its own stamp.

PyAV encodes them, which comes with the extra `test`; the package itself decodes with OpenCV.
"""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import stream_sfm as sfm
from stream_sfm.inspection.overview import inspect_log
from stream_sfm.logs.recording.stereo_log import StereoLog
from stream_sfm.logs.sources.video_references import FrameNumbers
from stream_sfm.logs.sources.video_stream import VideoStream, codec_of, starts_a_picture_group
from tests.helpers.stereo_logs import START_NS, LogWriter, calibration_of, write_info
from tests.helpers.wall import Wall, camera_path, rig

FRAMES, PERIOD_NS, GROUP = 24, 50_000_000, 6
RIG = rig(width=160, height=120)
ENCODERS = {"h264": "libx264", "h265": "libx265"}
TOPICS, INFOS = ("/cam/left/video", "/cam/right/video"), ("/cam/left/camera_info", "/cam/right/camera_info")
# As https://github.com/foxglove/foxglove-sdk and ffmpeg_image_transport_msgs define them
ROS = {
    "foxglove_msgs/msg/CompressedVideo":
    "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format\n",
    "ffmpeg_image_transport_msgs/msg/FFMPEGPacket":
    "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n"
    "bool is_bigendian\nuint8[] data\n",
}  # fmt: skip


def encoded(images: Sequence[np.ndarray], codec: str = "h264") -> list[bytes]:
    """One packet per image, a key frame with every sixth, nothing held back."""
    return [data for _, data in numbered(images, codec, 0)]


def numbered(images: Sequence[np.ndarray], codec: str, b_frames: int, **options: str) -> list[tuple[int, bytes]]:
    """The packets in the order of sending, each with the number of its image; `options`: others of the encoder."""
    av = pytest.importorskip("av", reason="PyAV, which encodes video for the tests, is not installed")
    encoder = av.CodecContext.create(ENCODERS[codec], "w")
    encoder.height, encoder.width = images[0].shape
    encoder.pix_fmt, encoder.time_base, encoder.framerate = options.pop("pixels", "yuv420p"), Fraction(1, 20), 20
    encoder.options = {
        "crf": "8", "g": str(GROUP), "bf": str(b_frames), **({} if b_frames else {"tune": "zerolatency"}),
        "x265-params": f"keyint={GROUP}:bframes={b_frames}:repeat-headers=1:log-level=none",
        "x264-params": f"keyint={GROUP}", **options,
    }  # fmt: skip
    packets = []
    for n, image in enumerate(images):
        frame = av.VideoFrame.from_ndarray(np.repeat(image[:, :, None], 3, axis=2), format="rgb24")
        frame.pts = n
        packets += [(packet.pts, bytes(packet)) for packet in encoder.encode(frame)]
    packets += [(packet.pts, bytes(packet)) for packet in encoder.encode(None)]
    assert len(packets) == len(images)
    return packets


@pytest.fixture(scope="module")
def pairs() -> list[tuple[np.ndarray, np.ndarray]]:
    return [(frame.left, frame.right) for frame in Wall(5).frames(RIG, camera_path(FRAMES))]


@pytest.fixture(scope="module")
def packets(pairs) -> tuple[list[bytes], list[bytes]]:
    return encoded([p[0] for p in pairs]), encoded([p[1] for p in pairs])


def write(
    path: Path,
    packets: Sequence[list[bytes]],
    form: str = "foxglove",
    codec: str = "h264",
    numbers: Sequence[Sequence[int]] = (range(FRAMES), range(FRAMES)),
) -> Path:
    """A log of both sides; an empty packet is left out. `form`: of the messages; `numbers`: of their stamps."""
    log, infos = LogWriter(path), calibration_of(RIG, "plumb_bob")
    for n, pair in enumerate(zip(*packets, strict=True)):
        for side, (topic, data) in enumerate(zip(TOPICS, pair, strict=True)):
            time, frame_id = START_NS + n * PERIOD_NS, ("left", "right")[side]
            if n == 0:
                write_info(log, "ros2", INFOS[side], time, infos[side], frame_id)
            if data:
                stamp_ns = START_NS + numbers[side][n] * PERIOD_NS
                write_video(log, form, topic, time, frame_id, codec, data, stamp_ns)
    log.close()
    return path


def write_video(
    log: LogWriter, form: str, topic: str, time: int, frame_id: str, codec: str, data: bytes, stamp_ns: int
) -> None:
    stamp = {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}
    if form in ("foxglove", "json"):
        fields = {"frame_id": frame_id, "data": data, "format": codec}
        log.foxglove(form, topic, CompressedVideo, fields, time)
    elif form == "sensor_msgs/msg/CompressedImage":
        header = {"stamp": stamp, "frame_id": frame_id}
        log.ros("ros2", topic, form, {"header": header, "format": codec, "data": data}, time)
    else:
        store = get_typestore(Stores.ROS2_HUMBLE)
        store.register(get_types_from_msg(ROS[form], form))
        kinds, pixels = store.types, np.frombuffer(data, np.uint8)
        at = kinds["builtin_interfaces/msg/Time"](**stamp)
        if form.startswith("foxglove"):
            message = kinds[form](at, frame_id, pixels, codec)
        else:
            header = kinds["std_msgs/msg/Header"](at, frame_id)
            message = kinds[form](header, 160, 120, ENCODERS[codec], 0, 0, False, pixels)
        definition, _ = store.generate_msgdef(form, ros_version=2)
        content = bytes(store.serialize_cdr(message, form))
        log.add(topic, form, ("cdr", "ros2msg"), definition.encode(), time, content)


def difference(frame: sfm.StereoFrame, images: tuple[np.ndarray, np.ndarray]) -> float:
    return max(float(abs(a.astype(float) - b).mean()) for a, b in zip(frame.images, images, strict=True))


def said(log: StereoLog) -> str:
    return " ".join(log.stats.warnings)


def check(log: StereoLog, pairs: Sequence[tuple[np.ndarray, np.ndarray]], expected: Sequence[int]) -> None:
    """The frames of the log are those of these numbers, each with its own images and stamp."""
    frames = list(log.frames())
    assert [f.stamp_ns for f in frames] == [START_NS + n * PERIOD_NS for n in expected]
    for frame, n in zip(frames, expected, strict=True):
        assert difference(frame, pairs[n]) < 2  # grey levels; the neighbours are at 3.7 and more


@pytest.mark.parametrize("form", ["foxglove", "json", "sensor_msgs/msg/CompressedImage", *ROS])
def test_every_message_that_holds_video_is_read(form, pairs, packets, tmp_path):
    path = write(tmp_path / "v.mcap", packets, form)
    log = sfm.open_log(path)
    check(log, pairs, range(FRAMES))
    assert log.stats.complete and not log.stats.warnings
    assert log.rig.baseline_m == pytest.approx(RIG.baseline_m)
    if form == "foxglove":
        assert not inspect_log(path)["problems"]


def test_h265(pairs, tmp_path):
    packets = [encoded([p[side] for p in pairs], "h265") for side in (0, 1)]
    check(sfm.open_log(write(tmp_path / "v.mcap", packets, codec="h265")), pairs, range(FRAMES))


@pytest.mark.parametrize("codec", ENCODERS)
def test_b_frames_are_right_with_their_own_stamps_and_refused_with_those_of_sending(codec, pairs, tmp_path):
    ros = "sensor_msgs/msg/CompressedImage"
    sent = [numbered([pair[side] for pair in pairs], codec, 3) for side in (0, 1)]
    packets, numbers = ([[packet[k] for packet in side] for side in sent] for k in (1, 0))
    assert all(n != sorted(n) for n in numbers)
    check(sfm.open_log(write(tmp_path / "own.mcap", packets, ros, codec, numbers)), pairs, range(FRAMES))
    log = sfm.open_log(write(tmp_path / "arrival.mcap", packets, ros, codec))
    shown = []
    with pytest.raises(sfm.LogError, match="shown in another order than they are sent"):
        shown.extend(log.frames())
    assert not shown


def test_frames_before_the_first_key_frame_are_counted(pairs, packets, tmp_path):
    late = [[b""] * 2 + packets[0][2:], [b""] * 4 + packets[1][4:]]
    log = sfm.open_log(write(tmp_path / "v.mcap", late))
    check(log, pairs, range(GROUP, FRAMES))
    assert log.stats.complete  # nobody could decode them
    for topic, count in zip(TOPICS, (4, 2), strict=True):
        assert f"{topic}: {count} frames of video before" in said(log)


def test_a_later_start_sees_the_same_images(packets, tmp_path):
    log = sfm.open_log(write(tmp_path / "v.mcap", packets))
    whole = {f.stamp_ns: f.left for f in log.frames()}
    later = list(log.frames(sfm.Selection(start_s=0.5, stride=3)))  # no frame of these is a key frame but one
    assert [f.stamp_ns for f in later] == [START_NS + n * PERIOD_NS for n in range(10, FRAMES, 3)]
    assert all(np.array_equal(f.left, whole[f.stamp_ns]) for f in later)


def test_a_broken_stream_loses_frames_and_not_the_run(pairs, packets, tmp_path):
    rng = np.random.default_rng(0)
    left = list(packets[0])
    left[8:12] = [rng.bytes(300) for _ in range(4)]
    log = sfm.open_log(write(tmp_path / "v.mcap", (left, packets[1])))
    numbers = [(f.stamp_ns - START_NS) // PERIOD_NS for f in log.frames()]
    assert numbers[:8] == list(range(8)) and set(range(12, FRAMES)) <= set(numbers) and len(numbers) < FRAMES
    assert not log.stats.complete
    assert f"{TOPICS[0]}: {FRAMES - len(numbers)} frames of video could not be decoded" in said(log)


def test_a_missing_message_costs_no_other_frame_its_stamp(pairs, packets, tmp_path):
    left = [b"" if n == 9 else data for n, data in enumerate(packets[0])]
    log = sfm.open_log(write(tmp_path / "v.mcap", (left, packets[1])))
    check(log, pairs, [n for n in range(FRAMES) if not 9 <= n < 2 * GROUP])  # the next ones refer to it
    assert f"{TOPICS[0]}: 2 frames of video left out: they depend on frames that are missing" in said(log)


@pytest.mark.parametrize("codec", ENCODERS)
def test_without_its_key_frame_a_group_of_pictures_is_left_out(codec, pairs, tmp_path):
    packets = [encoded([p[side] for p in pairs], codec) for side in (0, 1)]
    for side in packets:
        side[GROUP] = b""
    log = sfm.open_log(write(tmp_path / "v.mcap", packets, codec=codec))
    check(log, pairs, [*range(GROUP), *range(2 * GROUP, FRAMES)])
    assert not log.stats.complete and "5 frames of video" in said(log)


@pytest.mark.parametrize(
    "options",
    [
        {"bf": "3"},
        {"bf": "0", "g": "2", "tune": "zerolatency"},
        {"bf": "3", "x264-params": f"keyint={GROUP}:open-gop=1:ref=4"},
        {"bf": "0", "pixels": "yuv444p", "x264-params": f"keyint={GROUP}:cqm=jvt"},
    ],
)
def test_whichever_frame_is_lost_no_image_is_made_without_it(options, pairs):
    sent = numbered([p[0] for p in pairs[:14]], "h264", 0, **options)
    whole = dict(VideoStream("h264", iter(enumerate(data for _, data in sent))).pictures())
    assert len(whole) == len(sent)
    left_out = 0
    for lost in range(1, len(sent)):
        stream = VideoStream("h264", ((n, data) for n, (_, data) in enumerate(sent) if n != lost))
        assert all(np.abs(picture.astype(float) - whole[n]).mean() < 0.5 for n, picture in stream.pictures())
        left_out += stream.incomplete
    assert 0 < left_out < len(sent) * GROUP


def test_headers_that_cannot_be_read_lose_no_frame(packets):
    """Streams whose headers are damaged, cut or those of another encoder."""
    rng = np.random.default_rng(2)
    for _ in range(300):
        numbers, head = FrameNumbers(), bytearray(packets[0][0][:60])
        for at in rng.integers(4, 60, size=4):
            head[at] = rng.integers(256)
        assert numbers.are_complete(bytes(head[: rng.integers(5, 60)]))


def test_hostile_streams_end(packets, tmp_path):
    """Streams of damaged bytes with sound beginnings: they end, and lose what is lost."""
    rng = np.random.default_rng(1)
    for seed in range(20):
        damaged = []
        for data in packets[0]:
            content = bytearray(data)
            for at in rng.integers(len(content), size=1 + seed):
                content[at] = rng.integers(256)
            damaged.append(bytes(content[: rng.integers(1, len(content) + 1)]))
        stream = VideoStream("h264", iter(enumerate(damaged)))
        came = [n for n, _ in stream.pictures()]
        assert len(came) + stream.lost + stream.skipped + stream.incomplete == FRAMES
        assert came == sorted(set(came))


def test_errors_of_reading_are_raised_and_not_lost_in_the_decoder(packets):
    def frames():
        yield from enumerate(packets[0][:10])
        raise sfm.LogError("the disk has gone")

    with pytest.raises(sfm.LogError, match="the disk has gone"):
        list(VideoStream("h264", frames()).pictures())


@pytest.mark.parametrize(
    ("name", "codec"),
    [
        ("h264", "h264"), ("H.265", "h265"), ("libx264", "h264"), ("hevc_nvenc", "h265"), ("jpeg", None),
        ("vp9", None),
    ],
)  # fmt: skip
def test_names_of_codecs(name, codec):
    assert codec_of(name) == codec


def test_a_group_of_pictures_begins_with_the_parameters_of_the_stream():
    assert starts_a_picture_group("h264", b"\0\0\0\1\x09\x10\0\0\1\x67\x42")  # behind a delimiter
    assert not starts_a_picture_group("h264", b"\0\0\0\1\x41\x9a")
    assert starts_a_picture_group("h265", b"\0\0\0\1\x40\1\0\0\1\x42\1")
    assert not any(starts_a_picture_group("h264", data) for data in (b"", b"\0\0\1", b"\0\0\0\1\x09"))
