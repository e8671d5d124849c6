"""Every frame whose chunk is intact is read, whatever has happened to the bytes before it or to the index."""

import struct
from pathlib import Path

import pytest
from mcap.opcode import Opcode

from stream_sfm.mcap_file.damage import Damage
from stream_sfm.mcap_file.log_file import LogFile
from stream_sfm.mcap_file.walk import Walk
from tests.faults.damage_kinds import INDEXES, KINDS, trial, whole_log
from tests.faults.mutations import make_base
from tests.helpers.stereo_logs import CONTAINERS, Spec, write_log

_HEAD = struct.Struct("<BQ")


@pytest.mark.parametrize("container", ["zstd", "lz4", "uncompressed chunks"])
@pytest.mark.parametrize("index", INDEXES)
def test_all_frames_in_intact_chunks_are_read(container: str, index: str, path: Path, tmp_path: Path) -> None:
    whole = whole_log(write_log(tmp_path / "whole.mcap", Spec("foxglove", "png"), **CONTAINERS[container]))
    for kind in KINDS:
        trials = [trial(whole, index, kind, seed, path) for seed in range(8)]
        # Without an index a chunk with the only description of the cameras may be among those that are hit.
        lost = [t for t in trials if t.found < t.due]
        assert len(lost) <= (2 if index == "no index" else 0), kind
        assert all(t.found == 0 for t in lost), kind
        assert not any(t.silent for t in trials), kind


@pytest.mark.parametrize("change", [b"", b"\0", b"\5", b"\5\0\0"])
@pytest.mark.parametrize("after", [3, 4])
def test_unchunked_messages_behind_missing_and_added_bytes_are_read(
    change: bytes, after: int, path: Path, tmp_path: Path
) -> None:
    base = make_base("protobuf, unchunked", tmp_path)
    messages = [r for r in base.records if r.opcode == Opcode.MESSAGE]
    hit = messages[after]
    for at in range(hit.start + 1, hit.end, 97):
        path.write_bytes(base.data[:at] + change + base.data[at + (not change) :])
        damage = Damage()
        read = [m.data for m in LogFile(path).messages(damage)]
        intact = [base.data[m.start + 31 : m.end] for m in messages if m is not hit]
        assert [data for data in read if data in intact] == intact, at
        assert damage.notes, at


def test_the_bytes_of_a_message_whose_kind_is_wrong_are_missed_and_no_more(path: Path, tmp_path: Path) -> None:
    base = make_base("protobuf, unchunked", tmp_path)
    messages = [r for r in base.records if r.opcode == Opcode.MESSAGE]
    for kind in (1, 2, 3, 4, 6, 7, 9, 15):
        data = bytearray(base.data)
        data[messages[5].start] = kind
        path.write_bytes(data)
        damage = Damage()
        assert len(list(LogFile(path).messages(damage))) == len(messages) - 1, kind
        assert not damage.complete, kind


def test_chunks_that_are_cut_out_cleanly_are_missed_by_the_count(path: Path, tmp_path: Path) -> None:
    """The records left add up; only the index, which now lies elsewhere, knows better."""
    base = make_base("ROS 2, zstd", tmp_path)
    chunks = [n for n, r in enumerate(base.records) if r.opcode == Opcode.CHUNK]
    start, end = base.records[chunks[2]].start, base.records[chunks[3]].start
    path.write_bytes(base.data[:start] + base.data[end:])
    file, damage = LogFile(path), Damage()
    assert len(list(file.messages(damage))) < len(list(LogFile(tmp_path / "base.mcap").messages(Damage())))
    assert not damage.complete and file.index is not None
    assert f"it lies {end - start} bytes from where it was written" in damage.notes[0]
    assert len(file.index.chunk_channels) == len(chunks) - 1  # before the gap and, moved, behind it


def test_an_entry_of_the_index_that_is_wrong_costs_no_other(path: Path) -> None:
    write_log(path, Spec(), **CONTAINERS["zstd"])
    whole = whole_log(path)
    data = bytearray(path.read_bytes())
    at = whole.chunks[3][0]
    data[at + 9 : at + 17] = bytes(8)  # the time of its first message
    path.write_bytes(data)
    file, damage = LogFile(path), Damage()
    assert file.index is not None and sorted(file.index.chunk_channels) == [a for a, _ in whole.chunks if a != at]
    assert len(list(file.messages(damage))) == 26 and damage.complete
    assert f"1 of {len(whole.chunks)} chunks are not where it lists them" in damage.notes[0]


def test_definitions_are_found_behind_their_messages(path: Path) -> None:
    """The first chunk is destroyed, the index too; what is left of the summary describes the channels."""
    write_log(path, Spec(), **CONTAINERS["zstd"])
    whole = whole_log(path)
    data = bytearray(path.read_bytes())
    start, end = whole.chunks[0]
    data[start:end] = bytes(end - start)
    data[-12] ^= 1  # the checksum of the summary
    path.write_bytes(data)
    file, damage = LogFile(path), Damage()
    assert file.index is None
    read = {m.log_time_ns for m in file.messages(damage, whole.topics)}
    assert whole.intact([(start, end)]) <= read and not damage.complete


@pytest.mark.parametrize(
    "piece",
    [
        _HEAD.pack(Opcode.CHUNK, 2**26) + struct.pack("<QQQII", 0, 0, 2**26, 1, 0) + struct.pack("<Q", 2**26 - 40),
        _HEAD.pack(Opcode.CHUNK, 2**20) + struct.pack("<QQQII", 0, 0, 2**20, 1, 0) + struct.pack("<Q", 2**20 - 40),
        _HEAD.pack(Opcode.MESSAGE, 2**20) + struct.pack("<HIQQ", 1, 0, 0, 0),
        _HEAD.pack(Opcode.SCHEMA, 22)[:8],
        _HEAD.pack(0x80, 2**20),
        bytes(64),
    ],
    ids=["huge chunks", "chunks", "messages", "heads", "unknown records", "zeros"],
)
def test_bytes_that_look_like_records_cost_bounded_work(
    piece: bytes, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bytes of all reads are counted: some for each candidate, of which there are at most a million."""
    count, read = 0, Walk._read

    def counting(walk: Walk, at: int, size: int) -> bytes:
        nonlocal count
        count += size
        return read(walk, at, size)

    monkeypatch.setattr(Walk, "_read", counting)
    write_log(path, Spec(), use_chunking=False)
    data = path.read_bytes()
    path.write_bytes(data[:-100] + 7 * b"\xff" + piece * (2**21 // len(piece)) + data[-100:])
    assert sum(1 for m in LogFile(path).messages(Damage()) if m.channel.topic in Spec.topics) >= 20
    assert count < 2**29  # of a file of 2 MiB: some kilobytes for each of at most 50 000 places to resume
