"""Every frame in an intact chunk is read, whatever happened before it or to the index; losses are reported."""

import os
import struct
from pathlib import Path
from typing import IO

import pytest
from mcap.opcode import Opcode
from mcap.writer import CompressionType

import stream_sfm as sfm
from stream_sfm.logs.mcap_file import walk
from stream_sfm.logs.mcap_file.log_file import LogFile
from stream_sfm.logs.mcap_file.message import Damage
from tests.faults.damage import INDEXES, KINDS, Whole, trial, whole_log
from tests.faults.records import HEAD, channel, insert, message, record
from tests.helpers.stereo_logs import CONTAINERS, Spec, write_log


@pytest.fixture(scope="module")
def wholes(tmp_path_factory):
    """A log of 12 frames in each container."""
    folder = tmp_path_factory.mktemp("wholes")
    plain = {"chunk_size": 20_000, "compression": CompressionType.NONE, "enable_crcs": False}
    containers = CONTAINERS | {"no checksums": plain}
    return {
        name: whole_log(write_log(folder / f"{name}.mcap", Spec("foxglove", "png"), **container))
        for name, container in containers.items()
    }


@pytest.mark.parametrize("container", ["zstd", "lz4", "uncompressed chunks", "no checksums", "unchunked"])
@pytest.mark.parametrize("index", INDEXES)
def test_all_frames_in_intact_chunks_are_read(container, index, wholes, path):
    whole, due = wholes[container], 0
    for kind in KINDS:
        trials = [trial(whole, index, kind, seed, path) for seed in range(4)]
        # Without an index a chunk with the only description of the cameras may be among those that are hit.
        lost = [t for t in trials if t.found < t.due]
        assert len(lost) <= (2 if index == "no index" else 0), kind
        assert all(t.found == 0 for t in lost), kind
        assert not any(t.silent for t in trials), kind
        due += sum(t.due for t in trials)
    assert due > len(KINDS) * 4 * len(whole.frames) / 4  # the damage is not so bad that nothing is tested


def read(path: Path) -> tuple[list[int], list[str], bool]:
    """Stamps of the stereo frames, warnings, and whether all was read."""
    log = sfm.open_log(path)
    stamps = [pair.stamp_ns for pair in log.pairs()]
    return stamps, log.stats.warnings, log.stats.complete


def replaced(whole: Whole, path: Path, at: int, replacement: bytes) -> list[int]:
    """Write the log with other bytes at one place; returns the stamps of the undamaged one."""
    path.write_bytes(whole.data[:at] + replacement + whole.data[at + len(replacement) :])
    return list(whole.frames)


@pytest.mark.parametrize("length", [0, 7, 5000, 2**40, 2**64 - 1])
def test_a_wrong_length_of_a_chunk_costs_nothing(length, wholes, path):
    """It is given a second time inside the chunk, and the checksum confirms it."""
    whole = wholes["zstd"]
    start, _ = whole.pieces[2]
    expected = replaced(whole, path, start + 1, struct.pack("<Q", length))
    found, warnings, complete = read(path)
    assert found == expected and complete
    assert f"byte {start}: a chunk was read although its length, {length}, is wrong" in " ".join(warnings)


def test_an_end_in_the_middle_is_not_an_end(wholes, path):
    whole = wholes["no index"]
    ends = [*whole.of_kind(Opcode.DATA_END), *whole.of_kind(Opcode.FOOTER)]
    at = whole.pieces[2][0]
    for start, end in ends:
        path.write_bytes(whole.data[:at] + whole.data[start:end] + whole.data[at:])
        assert read(path)[0] == list(whole.frames)


def test_a_message_that_the_index_counts_and_nobody_finds_is_missed(wholes, path):
    """A flipped bit makes an unknown record of a message, and readers pass over unknown records."""
    whole = wholes["unchunked"]
    expected = replaced(whole, path, whole.pieces[-1][0], b"\x85")
    found, warnings, complete = read(path)
    assert found == expected[:-1] and not complete
    assert f"{path}: 11 of 12 messages of /camera/right/image could be read" in warnings


@pytest.mark.parametrize(
    ("container", "said"),
    [("zstd", "its checksum does not match its content"), ("no checksums", "it carries no checksum")],
)
def test_an_index_that_leads_astray_is_not_used_and_nothing_is_lost(container, said, wholes, path):
    whole = wholes[container]
    expected = replaced(whole, path, whole.data.rindex(b"/camera/right/image"), b"/camera/wrong/image")
    found, warnings, complete = read(path)
    assert found == expected and complete
    assert f"its index is not used: {said}" in warnings[0]


def test_chunks_that_are_cut_out_cleanly_are_missed_by_the_place_of_the_index(wholes, path):
    """The records left add up; only that the index now lies elsewhere tells."""
    whole = wholes["zstd"]
    (start, _), (end, _) = whole.pieces[1:3]
    path.write_bytes(whole.data[:start] + whole.data[end:])
    file, damage = LogFile(path), Damage()
    assert len(list(file.messages(damage))) < 26
    assert not damage.complete
    assert "its index lies elsewhere than the file says: bytes before it are missing" in damage.notes[0]


def test_an_entry_of_the_index_that_is_wrong_costs_no_other(wholes, path):
    whole = wholes["zstd"]
    at = whole.pieces[3][0]
    replaced(whole, path, at + 9, bytes(8))  # the time of its first message
    file, damage = LogFile(path), Damage()
    assert file.index is not None and sorted(file.index.chunk_channels) == [a for a, _ in whole.pieces if a != at]
    assert len(list(file.messages(damage))) == 26 and damage.complete
    assert f"1 of {len(whole.pieces)} chunks are not where it lists them" in damage.notes[0]


def test_definitions_are_found_behind_their_messages(wholes, path):
    """The first chunk is destroyed, the index too; what is left of the summary describes the channels."""
    whole = wholes["zstd"]
    start, end = whole.pieces[0]
    replaced(whole, path, start, bytes(end - start))
    data = bytearray(path.read_bytes())
    data[-12] ^= 1  # the checksum of the summary
    path.write_bytes(data)
    file, damage = LogFile(path), Damage()
    assert file.index is None
    found = {m.log_time_ns for m in file.messages(damage, whole.topics)}
    assert whole.intact([(start, end)]) <= found and not damage.complete


def test_records_of_gigabytes_are_passed_over_unread(path):
    """A sparse file: the lengths are true, the bytes are not there."""
    data = write_log(path, Spec(), use_chunking=False).read_bytes()
    head, huge = 8 + 9 + struct.unpack_from("<Q", data, 9)[0], 2**32
    with path.open("r+b") as stream:
        for n in range(3):
            stream.seek(head + n * (huge + 9))
            stream.write(HEAD.pack(Opcode.MESSAGE, huge))
        stream.seek(head + 3 * (huge + 9))
        stream.write(data[head:])
    found, warnings, complete = read(path)
    assert len(found) == 12 and not complete
    assert sum("a record of 4096 MiB was skipped" in w for w in warnings) == 3


def test_notes_of_damage_stay_few(path):
    insert(path, [message(999, b"", 0)] * 5000, container="unchunked")  # of no channel
    damage = Damage()
    assert sum(1 for _ in LogFile(path).messages(damage)) == 26
    assert not damage.complete and 1 < len(damage.notes) < 30  # of 5000 stray records


def test_channels_without_a_schema_are_passed_over_unless_they_are_the_cameras(path):
    topic = "/camera/left/image_raw"
    insert(path, [channel(999, 0, topic, "json"), message(999, b"{}")])
    assert len(list(sfm.open_log(path).frames())) == 12
    with pytest.raises(sfm.LogError, match=f"{topic} is not an image topic"):
        sfm.open_log(path, left=topic, right=Spec.topics[1])


@pytest.mark.parametrize(
    "piece",
    [
        HEAD.pack(Opcode.CHUNK, 2**26) + struct.pack("<QQQIIQ", 0, 0, 2**26, 1, 0, 2**26 - 40),
        HEAD.pack(Opcode.MESSAGE, 2**20) + struct.pack("<HIQQ", 1, 0, 0, 0),
        record(Opcode.SCHEMA, bytes(22))[:8],
        bytes(64),
    ],
    ids=["huge chunks", "messages", "heads", "zeros"],
)
def test_bytes_that_look_like_records_cost_bounded_work(piece, path, monkeypatch):
    """The bytes of all reads are counted: some for each candidate, of which there are at most a million."""
    count, read = 0, walk._read

    def counting(stream: IO[bytes], at: int, size: int) -> bytes:
        nonlocal count
        count += size
        return read(stream, at, size)

    monkeypatch.setattr(walk, "_read", counting)
    data = write_log(path, Spec(), use_chunking=False).read_bytes()
    path.write_bytes(data[:-100] + 7 * b"\xff" + piece * (2**20 // len(piece)) + data[-100:])
    assert sum(1 for m in LogFile(path).messages(Damage()) if m.channel.topic in Spec.topics) >= 20
    assert 2**20 < count < 2**28  # of a file of 1 MiB: some kilobytes for each of at most 25 000 places to resume


@pytest.mark.parametrize("container", ["zstd", "unchunked", "no index"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.999])
def test_a_file_that_becomes_shorter_while_it_is_read(tmp_path, container, share):
    path = write_log(tmp_path / "log.mcap", Spec(), **CONTAINERS[container])
    file, damage = LogFile(path), Damage()
    reading = file.messages(damage)
    next(reading)
    os.truncate(path, round(share * path.stat().st_size))
    list(reading)
    assert not damage.complete
    assert "became shorter while it was read" in " ".join(damage.notes)
    list(file.attachments(Damage()))  # raises nothing, too
