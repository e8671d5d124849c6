"""Small content that asks for hours or gigabytes: definitions, images, chunks, topics by the ten thousand."""

import struct
import tracemalloc
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import zstandard
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from mcap.opcode import Opcode

import stream_sfm as sfm
from stream_sfm.cli.main import main
from stream_sfm.mcap_file import chunks
from stream_sfm.recording.images import UndecodableImage, decode_grey
from stream_sfm.recording.messages import ImageMessage
from stream_sfm.recording.ros import ros_decoder
from stream_sfm.sources.image_header import problem
from tests.faults.test_memory import FRAMES, channel, chunk, definition, insert, message, record, schema
from tests.helpers.stereo_logs import scene, write_log

MIB = 2**20


def idl(members: str, constant: str = "1") -> bytes:
    constants = f"module T_C {{ const long X = {constant}; }};"
    return f"module p {{ module msg {{ {constants} struct T {{ {members} }}; }}; }};".encode()


HOSTILE = {
    "brackets in brackets": ("ros2idl", idl("long a;", "(" * 15 + "1" + ")" * 15)),  # an hour
    "products": ("ros2idl", b"module p { " + b"const long B = B * B; " * 40 + idl("long a;") + b"};"),
    "shifts": ("ros2idl", idl("long a;", "1 << 999999999")),
    "digits": ("ros2idl", idl("long a;", "9" * 5000)),
    "sequences in sequences": ("ros2idl", idl("sequence<" * 12 + "long" + ">" * 12 + " a;")),
    "brackets behind a comment": ("ros2idl", b'// "\n' + idl("long a;", "((((((1))))))") + b'\n// "'),
    "a negative length": ("ros1msg", b"uint8[-1] data\n"),
    "a length of many digits": ("ros1msg", b"uint8[99999999999999999999] data\n"),
    "a length of gigabytes": ("ros2msg", b"uint8[4294967295] data\n"),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_definitions_are_refused_at_once(name: str) -> None:
    encoding, text = HOSTILE[name]
    messages = "ros1" if encoding == "ros1msg" else "cdr"

    with pytest.raises(ValueError, match=r"\w"):
        ros_decoder(messages, encoding, "p/msg/T", text)


def test_what_ros_writes_in_idl_passes() -> None:
    text = idl('@verbatim (language="comment", text="a (small) * note") long a; sequence<double, 3> b;', "-12 << 3")
    assert ros_decoder("cdr", "ros2idl", "p/msg/T", b"// (((((\n/* ((((( */\n" + text) is not None


def png(width: int = 64, height: int = 48) -> bytes:
    return bytes(cv2.imencode(".png", scene(0, 0)[:height, :width])[1])


def png_chunk(kind: bytes, content: bytes, length: int | None = None) -> bytes:
    return (
        struct.pack(">I", len(content) if length is None else length)
        + kind
        + content
        + struct.pack(">I", zlib.crc32(kind + content))
    )


IMAGES = {
    "a chunk of 2 GiB": (png()[:33] + png_chunk(b"IDAT", b"x", 2**31 - 1), "a chunk of"),
    "a text of 2 GiB": (png()[:33] + png_chunk(b"zTXt", b"x", 2**31 - 1) + png()[33:], "a chunk of"),
    "a cut header": (png()[:40], "cut off"),
    "no header": (png()[:8] + png()[33:], "header"),
    "two headers": (png()[:33] + png()[8:], "header"),
    "an animation": (png()[:33] + png_chunk(b"acTL", bytes(8)) + png()[33:], "animation"),
    "a JPEG of very many scans": (
        bytes(cv2.imencode(".jpg", scene(0, 0), [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1]) + b"\xff\xda" * 100,
        "scans",
    ),
}


@pytest.mark.parametrize("name", IMAGES)
def test_images_that_would_fill_memory_are_not_decoded(name: str) -> None:
    data, why = IMAGES[name]
    assert why in problem(data)
    with pytest.raises(UndecodableImage, match="/left"):
        decode_grey(ImageMessage("/left", 0, "", True, "png", data))


@pytest.mark.parametrize("ending", [".png", ".jpg", ".webp"])
@pytest.mark.parametrize("progressive", [0, 1])
def test_sound_images_pass(ending: str, progressive: int) -> None:
    image = np.stack([scene(0, 0)] * 3, axis=-1)
    flags = [cv2.IMWRITE_JPEG_PROGRESSIVE, progressive] if ending == ".jpg" else []
    data = bytes(cv2.imencode(ending, image, flags)[1])
    assert problem(data) == "" and decode_grey(ImageMessage("/l", 0, "", True, "", data)).shape == scene(0, 0).shape


def test_a_chunk_holds_no_more_records_than_it_has_bytes_for(tmp_path: Path) -> None:
    """14.7 million empty records in 12 kB took 20 s a pass."""
    path = tmp_path / "log.mcap"
    empty = record(0x90, b"") * (14 * MIB)
    data = zstandard.ZstdCompressor(level=1).compress(empty)
    head = struct.pack("<QQQI", 0, 0, len(empty), 0) + struct.pack("<I4sQ", 4, b"zstd", len(data))
    insert(path, [record(Opcode.CHUNK, head + data)] * 3)
    log = sfm.open_log(path)
    assert len(list(log.pairs())) == FRAMES  # what is sound behind them is read
    assert not log.stats.complete and "it holds more records than bytes" in " ".join(log.stats.warnings)


def test_a_file_unpacks_to_no_more_than_it_could_hold(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chunks, "_FREE_BYTES", 100 * MIB)
    path = tmp_path / "log.mcap"
    insert(path, [chunk(record(0x90, bytes(60 * MIB)))] * 4)
    log = sfm.open_log(path)
    assert len(list(log.pairs())) == FRAMES and "not for the first time" in " ".join(log.stats.warnings)


def test_topics_by_the_ten_thousand_are_listed_in_part(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "log.mcap"
    said = schema(999, "foxglove.CompressedImage", "protobuf", definition(CompressedImage))
    pairs = (
        channel(1000 + n, 999, f"/cam{n // 2}/{('left', 'right')[n % 2]}/image", "protobuf")
        + message(1000 + n, b"")
        for n in range(20_000)
    )
    insert(path, [chunk(said + b"".join(pairs))])
    for command in (["inspect", str(path)], ["replay", str(path), "--out", str(tmp_path / "out")]):
        assert main(command) == 3
        printed = capsys.readouterr()
        assert len(printed.out) + len(printed.err) < 100_000
        assert "more" in printed.out + printed.err


def test_a_bag_of_images_is_read_in_little_memory(tmp_path: Path) -> None:
    """The allowance of a reading costs nothing where there is nothing to refuse."""
    log = sfm.open_log(write_log(tmp_path / "log.mcap"))
    tracemalloc.start()
    try:
        assert len(list(log.pairs())) == FRAMES and tracemalloc.get_traced_memory()[1] < 20 * MIB
    finally:
        tracemalloc.stop()
