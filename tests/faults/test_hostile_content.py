"""Small content that asks for hours or gigabytes: images, chunks, topics by the ten thousand."""

import struct
import zlib

import cv2
import numpy as np
import pytest
import zstandard
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from mcap.opcode import Opcode

import stream_sfm as sfm
from stream_sfm.mcap_file import chunks
from stream_sfm.recording.images import UndecodableImage, decode_grey
from stream_sfm.recording.messages import ImageMessage
from tests.faults.records import MIB, channel, chunk, definition, insert, message, record, schema
from tests.helpers.stereo_logs import scene

FRAMES = 12


def png(width: int = 64, height: int = 48) -> bytes:
    return bytes(cv2.imencode(".png", scene(0, 0)[:height, :width])[1])


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


@pytest.mark.parametrize(
    ("ending", "flags"), [(".png", []), (".jpg", []), (".jpg", [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]), (".webp", [])]
)
def test_sound_images_pass(ending, flags):
    data = bytes(cv2.imencode(ending, np.stack([scene(0, 0)] * 3, axis=-1), flags)[1])
    found = decode_grey(ImageMessage("/l", 0, "", True, "", data))
    assert found.tobytes() == cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE).tobytes()


def test_a_chunk_holds_no_more_records_than_it_has_bytes_for(tmp_path):
    """14.7 million empty records in 12 kB took 20 s a pass; here there are a third of them."""
    path = tmp_path / "log.mcap"
    empty = record(0x90, b"") * (5 * MIB)
    data = zstandard.ZstdCompressor(level=1).compress(empty)
    head = struct.pack("<QQQI", 0, 0, len(empty), 0) + struct.pack("<I4sQ", 4, b"zstd", len(data))
    insert(path, [record(Opcode.CHUNK, head + data)])
    log = sfm.open_log(path)
    assert len(list(log.pairs())) == FRAMES  # what is sound behind them is read
    assert not log.stats.complete and "it holds more records than bytes" in " ".join(log.stats.warnings)


def test_a_file_unpacks_to_no_more_than_it_could_hold(tmp_path, monkeypatch):
    monkeypatch.setattr(chunks, "_FREE_BYTES", 100 * MIB)
    path = tmp_path / "log.mcap"
    insert(path, [chunk(record(0x90, bytes(60 * MIB)))] * 4)
    log = sfm.open_log(path)
    assert len(list(log.pairs())) == FRAMES and "not for the first time" in " ".join(log.stats.warnings)


def test_topics_by_the_ten_thousand_are_listed_in_part(tmp_path, cli):
    path = tmp_path / "log.mcap"
    said = schema(999, "foxglove.CompressedImage", "protobuf", definition(CompressedImage))
    pairs = (
        channel(1000 + n, 999, f"/cam{n // 2}/{('left', 'right')[n % 2]}/image", "protobuf")
        + message(1000 + n, b"")
        for n in range(20_000)
    )
    insert(path, [chunk(said + b"".join(pairs))])
    for words in (["inspect", path], ["replay", path, "--out", tmp_path / "out"]):
        printed = "".join(cli(*words, code=3))
        assert len(printed) < 100_000 and "more" in printed  # characters, for 20 000 topics
