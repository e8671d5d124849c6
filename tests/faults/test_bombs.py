"""A few bytes that demand hours, gigabytes or files: work and memory stay bounded, and no intact frame is lost."""

import base64
import json
import struct
import tempfile
import tracemalloc
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import zstandard
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.descriptor_pb2 import FieldDescriptorProto
from mcap.opcode import Opcode
from mcap_protobuf.schema import build_file_descriptor_set
from mcap_ros2._dynamic import serialize_dynamic

import stream_sfm as sfm
from stream_sfm.logs.mcap_file.log_file import LogFile
from stream_sfm.logs.mcap_file.message import Source
from stream_sfm.logs.recording.images import UndecodableImage, decode_grey
from stream_sfm.logs.recording.messages import ImageMessage
from stream_sfm.logs.recording.transforms import fixed_edges
from stream_sfm.logs.sources.pose_files import read_poses, read_times
from stream_sfm.logs.sources.recognise import open_source
from stream_sfm.system.inputs import LIMITS
from tests.faults.records import (
    MIB,
    bag_chunk,
    bag_message,
    channel,
    chunk,
    definition,
    insert,
    message,
    record,
    schema,
)
from tests.helpers.bags import messages_of, write_bag1, write_bag2
from tests.helpers.memory import peaks_mib
from tests.helpers.stereo_logs import (
    CONTAINERS,
    PERIOD_NS,
    ROS2,
    START_NS,
    Calib,
    LogWriter,
    Spec,
    right_calib,
    scene,
    write_log,
    write_pair,
)

FRAMES = 12
MAX_MIB = 424  # of a process, which takes 80 with OpenCV; a message of 50 MiB stands in memory up to four times


def read(path: Path) -> tuple[int, str]:
    """The number of pairs that a damaged recording still has, and the notes about the damage."""
    log = sfm.open_log(path)
    count = len(list(log.pairs()))
    assert not log.stats.complete
    return count, " ".join(log.stats.warnings)


def png() -> bytes:
    return bytes(cv2.imencode(".png", scene(0, 0)[:48, :64])[1])


def png_chunk(kind: bytes, content: bytes, length: int | None = None) -> bytes:
    crc = struct.pack(">I", zlib.crc32(kind + content))
    return struct.pack(">I", len(content) if length is None else length) + kind + content + crc


IMAGES = {
    "256 megapixels": (
        bytes(cv2.imencode(".png", np.zeros((16_000, 16_000), np.uint8))[1]), "declare 16000×16000 pixels"
    ),
    "a chunk of 2 GiB": (png()[:33] + png_chunk(b"IDAT", b"x", 2**31 - 1), "a chunk of"),
    "a text of 2 GiB": (png()[:33] + png_chunk(b"zTXt", b"x", 2**31 - 1) + png()[33:], "a chunk of"),
    "a cut header": (png()[:40], "cut off"),
    "no header": (png()[:8] + png()[33:], "that declare"),
    "two headers": (png()[:33] + png()[8:], "header"),
    "an animation": (png()[:33] + png_chunk(b"acTL", bytes(8)) + png()[33:], "animation"),
    "a JPEG of very many scans": (
        bytes(cv2.imencode(".jpg", scene(0, 0), [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1]) + b"\xff\xda" * 100,
        "scans",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", IMAGES)
def test_images_that_would_fill_memory_are_not_decoded(name):
    data, why = IMAGES[name]
    with pytest.raises(UndecodableImage, match=f"/left: .*{why}"):
        decode_grey(ImageMessage("/left", 0, "", True, "png", data))


def test_a_chunk_holds_no_more_records_than_it_has_bytes_for(path, monkeypatch):
    """14.7 million empty records in 12 kB took 20 s a pass."""
    monkeypatch.setattr("stream_sfm.logs.mcap_file.chunks._FREE_RECORDS", 10_000)
    insert(path, [chunk(record(0x90, b"") * 100_000)])
    count, said = read(path)
    assert count == FRAMES and "it holds more records than bytes" in said  # what is sound behind them is read


def test_a_file_unpacks_to_no_more_than_it_could_hold(path, monkeypatch):
    monkeypatch.setattr("stream_sfm.logs.mcap_file.chunks._FREE_BYTES", 100 * MIB)
    insert(path, [chunk(record(0x90, bytes(60 * MIB)))] * 4)
    count, said = read(path)
    assert count == FRAMES and "not for the first time" in said


def test_topics_by_the_ten_thousand_are_listed_in_part(path, tmp_path, cli, monkeypatch):
    readings, messages = [], LogFile.messages
    monkeypatch.setattr(LogFile, "messages", lambda *args: readings.append(args) or messages(*args))
    said = schema(999, "foxglove.CompressedImage", "protobuf", definition(CompressedImage))
    pairs = (
        channel(1000 + n, 999, f"/cam{n // 2}/{('left', 'right')[n % 2]}/image", "protobuf") + message(1000 + n, b"")
        for n in range(5000)
    )
    insert(
        path,
        [chunk(said + b"".join(pairs) + channel(40_000, 999, "/long" * 13_000, "protobuf") + message(40_000, b""))],
    )
    report = sfm.inspect(path)
    assert len(report["topics"]) <= 4096 and any("only 4096 topics with names of" in w for w in report["warnings"])
    for words in (["inspect", path], ["replay", path, "--out", tmp_path / "out"]):
        printed = "".join(cli(*words, code=3))
        assert len(printed) < 25_000 and "more" in printed  # characters, for 5000 topics
    assert len(readings) < 3 * 100  # one for each topic took minutes


@pytest.fixture
def bag1(path):
    """A ROS 1 bag without an index."""
    data = write_bag1(path.with_suffix(".bag"), messages_of(write_log(path, Spec(profile="ros1")))).read_bytes()
    return data.replace(data.split(b"index_pos=")[1][:8], bytes(8), 1)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (bytes(8 * MIB), "there is no record (zeros, or damage)"),
        (bag_message(999) * 100_000, "a message of a connection that is not described"),
        (bag_message(0) * 100_000, "it holds more records than bytes"),  # 16 million in 160 bytes took 75 s
        (bytes(120 * MIB), "declare over 1000 times as many"),
    ],
)
def test_a_chunk_of_a_bag_costs_little_work(bag1, path, monkeypatch, content, says):
    monkeypatch.setattr("stream_sfm.logs.mcap_file.chunks._FREE_RECORDS", 10_000)
    monkeypatch.setattr("stream_sfm.logs.sources.containers.ros1_bag._FREE_BYTES", 100 * MIB)
    path.write_bytes(bag1 + bag_chunk(content))
    count, said = read(path)
    assert count == FRAMES and "a damaged record was skipped: " in said and says in said


def test_compressed_splits_together_hold_no_more_than_a_bag(tmp_path, monkeypatch):
    monkeypatch.setattr("stream_sfm.logs.sources.rosbag2._FREE_BYTES", 40 * MIB)
    bomb = zstandard.compress(bytes(30 * MIB))
    for n in range(6):
        (tmp_path / f"walk_{n}.mcap.zstd").write_bytes(bomb)
    with pytest.raises(sfm.LogError, match="far more than a recording"):
        sfm.open_log(tmp_path)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_nothing_is_left_of_a_compressed_bag_however_its_reader_ends(tmp_path, monkeypatch, storage):
    messages = messages_of(write_log(tmp_path / "log.mcap", Spec(profile="ros2")))
    walk = write_bag2(tmp_path / "walk", messages, storage, "file")
    (copies := tmp_path / "copies").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(copies))
    pairs = sfm.open_log(walk).pairs()
    assert next(pairs) and not list(copies.iterdir())  # its copy has no name


@pytest.mark.parametrize("line", [b"1.5\n", b"0.1 " * 16])
def test_a_text_of_very_many_stamps_is_refused(tmp_path, monkeypatch, line):
    monkeypatch.setattr("stream_sfm.logs.sources.pose_files.LIMITS", LIMITS._replace(indexed=10_000))
    (tmp_path / "times.txt").write_bytes(line * 20_000)
    for reader in (read_times, read_poses):
        with pytest.raises(sfm.LogError, match=r"is it another file|columns|time"):
            reader(tmp_path / "times.txt")


def image(name: str, encodings: tuple[str, str], told: bytes, data: bytes) -> list[bytes]:
    """A message on the topic of the left camera, of this type and definition."""
    said = schema(999, name, encodings[1], told) + channel(1000, 999, Spec.topics[0], encodings[0])
    return [chunk(said + message(1000, data))]


def values_in_json() -> list[bytes]:
    png64 = base64.b64encode(png()).decode()
    text = json.dumps({"timestamp": {"sec": 1, "nsec": 0}, "format": "png", "data": png64})
    more = ',"more":[' + "[]," * (10 * MIB) + "[]]}"
    return image("foxglove.CompressedImage", ("json", "jsonschema"), b"{}", (text[:-1] + more).encode())


def parts_in_ros() -> list[bytes]:
    """Each of one byte, and an object of Python's."""
    name, count = "sensor_msgs/msg/CompressedImage", 5 * MIB
    told = ROS2[name].replace("uint8[] data\n", "uint8[] data\nPart[] parts\n", 1)
    told += "=" * 16 + "\nMSG: sensor_msgs/Part\nuint8 b\n"
    header = {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": "left"}
    data = serialize_dynamic(name, ROS2[name])[name]({"header": header, "format": "png", "data": png()})
    data += bytes(-(len(data) - 4) % 4) + struct.pack("<I", count) + bytes(count)
    return image(name, ("cdr", "ros2msg"), told.encode(), data)


def parts_in_protobuf() -> list[bytes]:
    """Each of three bytes, by a definition that has a field more than Foxglove's."""
    files = build_file_descriptor_set(CompressedImage)
    kind = next(m for f in files.file for m in f.message_type if m.name == "CompressedImage")
    more = {"label": FieldDescriptorProto.LABEL_REPEATED, "type": FieldDescriptorProto.TYPE_MESSAGE}
    kind.field.add(name="more", number=50, type_name=".google.protobuf.Timestamp", **more)
    data = CompressedImage(format="png", data=png()).SerializeToString() + b"\x92\x03\x00" * (15 * MIB)
    return image("foxglove.CompressedImage", ("protobuf", "protobuf"), files.SerializeToString(), data)


def names_of_gigabytes() -> list[bytes]:
    data = CompressedImage(frame_id="a" * (50 * MIB), format="png", data=png()).SerializeToString()
    return 8 * image("foxglove.CompressedImage", ("protobuf", "protobuf"), definition(CompressedImage), data)


def calibrations_of_gigabytes() -> Iterator[bytes]:
    data = CameraCalibration(frame_id="a" * (50 * MIB)).SerializeToString()
    said = schema(999, "foxglove.CameraCalibration", "protobuf", definition(CameraCalibration))
    for n in range(8):
        yield chunk(said + channel(1000 + n, 999, f"/{n}/info", "protobuf") + message(1000 + n, data))


LOGS: dict[str, Callable[[], Iterable[bytes]]] = {  # records before those of a sound log
    "schemas": lambda: (chunk(schema(1000 + n, "x", "", bytes(50 * MIB))) for n in range(8)),
    "channels": lambda: (  # each of a size that is allowed
        chunk(b"".join(channel(9000 + 6 * n + m, 0, b"a" * (7 * MIB), "") for m in range(6))) for n in range(10)
    ),
    "calibrations": calibrations_of_gigabytes,
    "names of frames": names_of_gigabytes,
    "values in JSON": values_in_json,
    "parts in ROS": parts_in_ros,
    "parts in protobuf": parts_in_protobuf,
}
COMMANDS = """
from stream_sfm.cli.main import main
command, *logs = sys.argv[1:]
for log in logs:
    main([*command.split(), log, *(["--out", log + ".out"] if command.startswith("replay") else [])])
    peak()
"""


@pytest.mark.slow
def test_small_logs_take_no_gigabytes(tmp_path):
    """One after the other in one process, which has read most of them when it comes to the last one."""
    logs = [tmp_path / f"{name}.mcap".replace(" ", "_") for name in LOGS]
    for log, records in zip(logs, LOGS.values(), strict=True):
        insert(log, records())
        assert log.stat().st_size < 2 * MIB
    found = peaks_mib(COMMANDS, "replay --method frame-to-frame", *logs)
    assert max(found) < MAX_MIB, found
    for log in logs:
        summary = json.loads(Path(f"{log}.out", "summary.json").read_text())
        assert summary["frames"]["estimated"] == FRAMES, log


@pytest.mark.slow
def test_inspection_keeps_few_images_where_they_are_large(tmp_path):
    """All pairs were to be kept; with 24 of them instead of 4, these would be 490 MB more."""
    black, logs = np.zeros((3500, 3500), np.uint8), [tmp_path / f"{pairs}.mcap" for pairs in (4, 24)]
    for path in logs:
        log = LogWriter(path, chunk_size=1000)
        for n in range(int(path.stem)):
            write_pair(log, "foxglove", START_NS + n * PERIOD_NS, (black, black), (Calib(), right_calib()), "mono8")
        log.close()
    few, many, _ = peaks_mib(COMMANDS, "inspect", *logs)
    assert many - few < 245


def transforms_log(path: Path, *children: Iterable[str]) -> Source:
    """A log with messages on /tf, each of transforms from `a` to so many others."""
    name, zero, unit = "tf2_msgs/msg/TFMessage", dict.fromkeys("xyz", 0.0), dict.fromkeys("xyz", 0.0) | {"w": 1.0}
    header = {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": "a"}
    moved = {"header": header, "transform": {"translation": zero, "rotation": unit}}
    encode = serialize_dynamic(name, ROS2[name])[name]
    data = [encode({"transforms": [moved | {"child_frame_id": c} for c in named]}) for named in children]
    said = schema(999, name, "ros2msg", ROS2[name].encode()) + channel(1000, 999, "/tf", "cdr")
    insert(path, [chunk(said + b"".join(message(1000, d) for d in data))])
    return open_source(path)


def test_frames_of_reference_by_the_thousand_are_not_all_kept(path):
    source = transforms_log(path, *(map(str, range(first, first + 500)) for first in range(0, 6000, 500)))
    edges = fixed_edges(source, frozenset(["/tf"]))
    assert ("a", "0") in edges and len(edges) < 5000  # of 6000


def test_a_message_of_very_many_transforms_is_passed_over(path):
    source = transforms_log(path, ["b"] * 15_000, ["c"])
    assert list(fixed_edges(source, frozenset(["/tf"]))) == [("a", "c")]


def test_damaged_depth_images_are_reported_once(path):
    said = schema(999, "foxglove.CompressedImage", "protobuf", definition(CompressedImage))
    said += channel(1000, 999, "/ground_truth/depth", "protobuf")
    bad = [CompressedImage(format="png", data=bytes(n)).SerializeToString() for n in range(200)]
    insert(path, [chunk(said + b"".join(message(1000, d) for d in bad))], Spec(truth=True))
    log = sfm.open_log(path)
    assert len(list(log.depths())) == FRAMES
    assert len(log.stats.warnings) == 1 and "/ground_truth/depth" in log.stats.warnings[0]


def test_an_index_that_lists_very_many_channels_is_not_unfolded(path):
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
    tracemalloc.start()
    LogFile(path)
    assert tracemalloc.get_traced_memory()[1] < 30 * MIB  # 5 of them the summary; unfolded they were some 60
    tracemalloc.stop()
