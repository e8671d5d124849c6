"""MCAP files of every layout give the messages that the mcap library finds; damage costs only what it hits."""

import struct
from pathlib import Path

import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from stream_sfm.logs.mcap_file.log_file import LogFile
from stream_sfm.logs.mcap_file.message import Damage
from tests.helpers.stereo_logs import CONTAINERS, Spec, write_log


def two_topics(path: Path, chunks: int = 6, per_chunk: int = 3) -> list[bytes]:
    """A log whose chunks hold one topic each, in turn; returns the payloads."""
    payloads = []
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=2**30, compression=CompressionType.ZSTD)
        writer.start("test", "tests")
        schema = writer.register_schema("kind", "jsonschema", b"{}")
        channels = [writer.register_channel(topic, "json", schema) for topic in ("/a", "/b")]
        for n in range(chunks):
            for m in range(per_chunk):
                payloads.append(f"{n}.{m}".encode())
                writer.add_message(channels[n % 2], 10 * n + m, payloads[-1], 10 * n + m)
            writer.flush()
        writer.add_attachment(0, 0, "notes.txt", "text/plain", b"hello")
        writer.finish()
    return payloads


@pytest.mark.parametrize("container", CONTAINERS)
def test_the_messages_are_those_of_the_mcap_library(path: Path, container: str) -> None:
    write_log(path, Spec(), **CONTAINERS[container])
    with path.open("rb") as stream:
        expected = [
            (s.name, c.topic, m.log_time, m.data) for s, c, m in make_reader(stream).iter_messages(log_time_order=False)
        ]
    damage = Damage()
    found = [(m.channel.schema_name, m.channel.topic, m.log_time_ns, m.data) for m in LogFile(path).messages(damage)]
    assert found == expected and len(found) == 26
    assert damage.complete and not damage.notes and damage.bytes_read == path.stat().st_size


def test_chunks_without_a_wanted_topic_are_not_opened(path: Path) -> None:
    two_topics(path)
    data = bytearray(path.read_bytes())
    chunk = data.index(struct.pack("<B", Opcode.CHUNK), 8)
    while data[chunk + 9 : chunk + 17] != bytes(8):  # its first log time is 0: the first chunk, of /a
        chunk = data.index(struct.pack("<B", Opcode.CHUNK), chunk + 1)
    data[chunk + 9 + 60] ^= 0xFF
    path.write_bytes(data)
    damage = Damage()
    assert len(list(LogFile(path).messages(damage, frozenset(["/b"])))) == 9 and damage.complete
    assert len(list(LogFile(path).messages(damage, frozenset(["/a"])))) == 6 and not damage.complete
    assert any("a damaged chunk" in note for note in damage.notes)


def test_readings_do_not_disturb_each_other(path: Path) -> None:
    payloads = two_topics(path)
    file = LogFile(path)
    readings = [file.messages(Damage()) for _ in range(2)]
    assert [next(r).data for r in readings] == payloads[:1] * 2
    assert [[m.data for m in r] for r in readings] == [payloads[1:]] * 2


def test_attachments_and_the_header(path: Path) -> None:
    two_topics(path)
    file = LogFile(path)
    assert [(a.name, a.data) for a in file.attachments(Damage())] == [("notes.txt", b"hello")]
    assert list(file.attachments(Damage(), max_bytes=10)) == []
    assert (file.profile, file.library) == ("test", "tests")
