"""Logs of some kilobytes that would take gigabytes: what is read of them stays bounded, and no frame is lost."""

import base64
import json
import struct
import tracemalloc
import zlib
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.descriptor_pb2 import FieldDescriptorProto
from mcap.opcode import Opcode
from mcap_protobuf.schema import build_file_descriptor_set
from mcap_ros2._dynamic import serialize_dynamic

import stream_sfm as sfm
from stream_sfm.mcap_file.log_file import LogFile
from stream_sfm.recording.ground_truth import read_truth
from stream_sfm.recording.transforms import fixed_edges
from stream_sfm.sources.recognise import open_source
from tests.faults.records import MIB, channel, chunk, definition, insert, message, record, schema
from tests.helpers.memory import peaks_mib
from tests.helpers.stereo_logs import (
    CONTAINERS,
    PERIOD_NS,
    ROS2,
    START_NS,
    Calib,
    LogWriter,
    Spec,
    encode,
    right_calib,
    scene,
    write_image,
    write_info,
    write_log,
)

pytestmark = pytest.mark.slow

MAX_MIB = 768  # a process with OpenCV takes 80, a message of 100 MiB stands in memory up to four times
FRAMES = 12
BAD = 5  # the frame that means harm
ROS_IMAGE = "sensor_msgs/msg/CompressedImage"


def images(
    path: Path, profile: str, write: Callable[[LogWriter, int, int, int], bool], frames: int = FRAMES
) -> None:
    """So many frames; `write(log, frame, side, stamp)` may write an image itself, and then tells so."""
    log = LogWriter(path, chunk_size=1000)
    for n in range(frames):
        stamp_ns = START_NS + n * PERIOD_NS
        for topic, info in zip(Spec.info_topics, (Calib(), right_calib()), strict=True):
            if n == 0:
                write_info(log, profile, topic, stamp_ns, info)
        for side, topic in enumerate(Spec.topics):
            if not write(log, n, side, stamp_ns):
                write_image(log, profile, topic, stamp_ns, scene(n, side), "png")
    log.close()


def schemas_of_gigabytes(path: Path) -> None:
    insert(path, (chunk(schema(1000 + n, "x", "", bytes(100 * MIB))) for n in range(8)))


def channels_of_gigabytes(path: Path) -> None:
    """Each of a size that is allowed."""
    topic = b"a" * (7 * MIB)
    insert(path, (chunk(b"".join(channel(9000 + 12 * n + m, 0, topic, "") for m in range(12))) for n in range(10)))


def calibrations_of_gigabytes(path: Path) -> None:
    data = CameraCalibration(frame_id="a" * (100 * MIB)).SerializeToString()
    said = schema(999, "foxglove.CameraCalibration", "protobuf", definition(CameraCalibration))
    insert(
        path,
        (
            chunk(said + channel(1000 + n, 999, f"/{n}/info", "protobuf") + message(1000 + n, data))
            for n in range(8)
        ),
    )


def names_of_frames(path: Path) -> None:
    """On the left, so that they wait for the right ones."""

    def write(log: LogWriter, n: int, side: int, stamp_ns: int) -> bool:
        for early in range(10) if (n, side) == (BAD, 0) else ():
            name = "a" * (100 * MIB)
            write_image(log, "foxglove", Spec.topics[0], stamp_ns + 1 + early, scene(n, 0), "png", name)
        return False

    images(path, "foxglove", write)


def values_in_json(path: Path) -> None:
    def write(log: LogWriter, n: int, side: int, stamp_ns: int) -> bool:
        if (n, side) != (BAD, 0):
            return False
        sec, nsec = divmod(stamp_ns, 10**9)
        data = base64.b64encode(encode(scene(n, side), "png")[0]).decode()
        image = json.dumps({"timestamp": {"sec": sec, "nsec": nsec}, "format": "png", "data": data})
        more = ',"more":[' + "[]," * (20 * MIB) + "[]]}"
        kind = ("json", "jsonschema")
        log.add(Spec.topics[0], "foxglove.CompressedImage", kind, b"{}", stamp_ns, (image[:-1] + more).encode())
        return True

    images(path, "json", write)


def parts_in_ros(path: Path) -> None:
    """Each of one byte, and an object of Python's."""
    more = "uint8[] data\nPart[] parts\n"
    told = ROS2[ROS_IMAGE].replace("uint8[] data\n", more, 1) + "=" * 16 + "\nMSG: sensor_msgs/Part\nuint8 b\n"

    def write(log: LogWriter, n: int, side: int, stamp_ns: int) -> bool:
        sec, nsec = divmod(stamp_ns, 10**9)
        header = {"stamp": {"sec": sec, "nanosec": nsec}, "frame_id": "left"}
        image = {"header": header, "format": "png", "data": encode(scene(n, side), "png")[0]}
        data = serialize_dynamic(ROS_IMAGE, ROS2[ROS_IMAGE])[ROS_IMAGE](image)
        count = 10 * MIB if (n, side) == (BAD, 0) else 0
        data += bytes(-(len(data) - 4) % 4) + struct.pack("<I", count) + bytes(count)
        log.add(Spec.topics[side], ROS_IMAGE, ("cdr", "ros2msg"), told.encode(), stamp_ns, data)
        return True

    images(path, "ros2", write)


def parts_in_protobuf(path: Path) -> None:
    """Each of three bytes, by a definition that has a field more than Foxglove's."""
    files = build_file_descriptor_set(CompressedImage)
    kind = next(m for f in files.file for m in f.message_type if m.name == "CompressedImage")
    more = {"label": FieldDescriptorProto.LABEL_REPEATED, "type": FieldDescriptorProto.TYPE_MESSAGE}
    kind.field.add(name="more", number=50, type_name=".google.protobuf.Timestamp", **more)

    def write(log: LogWriter, n: int, side: int, stamp_ns: int) -> bool:
        image = CompressedImage(format="png", data=encode(scene(n, side), "png")[0])
        image.timestamp.FromNanoseconds(stamp_ns)
        data = image.SerializeToString() + (b"\x92\x03\x00" * (30 * MIB) if (n, side) == (BAD, 0) else b"")
        told = files.SerializeToString()
        log.add(Spec.topics[side], "foxglove.CompressedImage", ("protobuf", "protobuf"), told, stamp_ns, data)
        return True

    images(path, "foxglove", write)


LOGS: dict[str, tuple[Callable[[Path], None], int]] = {  # and the frames that are left
    "schemas": (schemas_of_gigabytes, FRAMES),
    "channels": (channels_of_gigabytes, FRAMES),
    "calibrations": (calibrations_of_gigabytes, FRAMES),
    "names of frames": (names_of_frames, FRAMES),
    "values in JSON": (values_in_json, FRAMES - 1),
    "parts in ROS": (parts_in_ros, FRAMES - 1),
    "parts in protobuf": (parts_in_protobuf, FRAMES - 1),
}


COMMANDS = """
from stream_sfm.cli.main import main
command, *logs = sys.argv[1:]
for log in logs:
    main([*command.split(), log, *(["--out", log + ".out"] if command.startswith("replay") else [])])
    peak()
"""


def test_small_logs_take_no_gigabytes(tmp_path):
    """One after the other in one process, which has read most of them when it comes to the last one."""
    for name, (write, _) in LOGS.items():
        write(tmp_path / f"{name}.mcap".replace(" ", "_"))
    logs = [tmp_path / f"{name}.mcap".replace(" ", "_") for name in LOGS]
    assert all(log.stat().st_size < 2 * MIB for log in logs)
    found = peaks_mib(COMMANDS, "replay --method frame-to-frame", *logs)
    assert max(found) < MAX_MIB, found
    for log, (_, frames) in zip(logs, LOGS.values(), strict=True):
        summary = json.loads(Path(f"{log}.out", "summary.json").read_text())
        assert summary["frames"]["estimated"] == frames, log


def test_inspection_keeps_few_images_where_they_are_large(tmp_path):
    """All pairs were to be kept; with 24 of them instead of 4, these would be 490 MB more."""
    black = np.zeros((3500, 3500), np.uint8)

    def write(log: LogWriter, n: int, side: int, stamp_ns: int) -> bool:
        write_image(log, "foxglove", Spec.topics[side], stamp_ns, black, "mono8")
        return True

    logs = [tmp_path / f"{pairs}.mcap" for pairs in (4, 24)]
    for log, pairs in zip(logs, (4, 24), strict=True):
        images(log, "foxglove", write, pairs)
    few, many, _ = peaks_mib(COMMANDS, "inspect", *logs)
    assert many - few < 245


def transforms_log(path: Path, data: Iterable[bytes]) -> None:
    name = "tf2_msgs/msg/TFMessage"
    said = schema(999, name, "ros2msg", ROS2[name].encode()) + channel(1000, 999, "/tf", "cdr")
    insert(path, [chunk(said + b"".join(message(1000, d) for d in data))])


def transforms(children: Iterable[str]) -> bytes:
    name = "tf2_msgs/msg/TFMessage"
    zero, unit = dict.fromkeys("xyz", 0.0), dict.fromkeys("xyz", 0.0) | {"w": 1.0}
    header = {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": "a"}
    moved = {"header": header, "transform": {"translation": zero, "rotation": unit}}
    return serialize_dynamic(name, ROS2[name])[name](
        {"transforms": [moved | {"child_frame_id": c} for c in children]}
    )


def test_frames_of_reference_by_the_thousand_are_not_all_kept(tmp_path):
    path = tmp_path / "log.mcap"
    transforms_log(path, [transforms(str(n) for n in range(first, first + 500)) for first in range(0, 6000, 500)])
    edges = fixed_edges(open_source(path), frozenset(["/tf"]))
    assert ("a", "0") in edges and len(edges) < 5000  # of 6000


def test_a_message_of_very_many_transforms_is_passed_over(tmp_path):
    path = tmp_path / "log.mcap"
    transforms_log(path, [transforms(["b"] * 15_000), transforms(["c"])])
    assert list(fixed_edges(open_source(path), frozenset(["/tf"]))) == [("a", "c")]


def test_damaged_depth_images_are_told_once(tmp_path):
    path = tmp_path / "log.mcap"
    said = schema(999, "foxglove.CompressedImage", "protobuf", definition(CompressedImage))
    said += channel(1000, 999, "/ground_truth/depth", "protobuf")
    bad = [CompressedImage(format="png", data=bytes(n)).SerializeToString() for n in range(200)]
    insert(path, [chunk(said + b"".join(message(1000, d) for d in bad))], Spec(truth=True))
    log = sfm.open_log(path)
    assert len(list(log.depths())) == FRAMES
    assert len(log.stats.warnings) == 1 and "/ground_truth/depth" in log.stats.warnings[0]


def peak_mib(work: Callable[[], object]) -> float:
    """What Python allocates at most while at work, MiB."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1] / MIB
    finally:
        tracemalloc.stop()


def test_ground_truth_takes_little_a_pose(tmp_path):
    path = tmp_path / "log.mcap"
    count = 3_000
    said = schema(999, "foxglove.PoseInFrame", "protobuf", definition(PoseInFrame))
    said += channel(1000, 999, "/gt/pose", "protobuf")
    pose = PoseInFrame(frame_id="world")
    pose.pose.orientation.w = 1
    data = []
    for n in range(count):
        pose.timestamp.FromNanoseconds(START_NS + n * 1000)
        data.append(message(1000, pose.SerializeToString()))
    insert(path, [chunk(said), *(chunk(b"".join(data[n : n + 1000])) for n in range(0, count, 1000))])
    source = open_source(path)
    assert peak_mib(lambda: read_truth(source, "/gt/pose", "left", [])) * MIB / count < 500  # bytes; objects: 800


def test_an_index_that_lists_very_many_channels_is_not_unfolded(tmp_path):
    path = tmp_path / "log.mcap"
    data = write_log(path, **CONTAINERS["unchunked"]).read_bytes()
    tail = 9 + 20 + 8
    (start,) = struct.unpack_from("<Q", data, len(data) - tail + 9)
    offsets = b"".join(struct.pack("<HQ", n, 2**40 + n) for n in range(2**16))
    listed = struct.pack("<QQQQI", 0, 0, 8, 0, len(offsets)) + offsets + bytes(8 + 4 + 16)
    # before the statistics, which the offsets at the end of the summary do not name
    summary = 8 * record(Opcode.CHUNK_INDEX, listed) + data[start:-tail]
    footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, 0)
    crc = zlib.crc32(footer, zlib.crc32(summary))
    path.write_bytes(data[:start] + summary + footer + struct.pack("<I", crc) + data[-8:])
    assert LogFile(path).index is not None
    assert peak_mib(lambda: LogFile(path)) < 30  # 5 of them the summary; unfolded they were some 60
