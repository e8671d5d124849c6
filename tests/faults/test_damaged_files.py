"""Damage of one kind at a known place: what it costs, and what is said of it."""

import struct
from pathlib import Path

import pytest
from mcap.opcode import Opcode

import stream_sfm as sfm
from stream_sfm.mcap_file.damage import Damage
from stream_sfm.mcap_file.log_file import LogFile
from tests.faults.mutations import Base, make_base
from tests.helpers.stereo_logs import PERIOD_NS, START_NS, LogWriter, Spec, scene, write_image, write_log

FAST = sfm.Config(method="frame-to-frame")


def read(path: Path) -> tuple[list[int], list[str], bool]:
    """Stamps of the stereo frames, warnings, and whether all was read."""
    log = sfm.open_log(path)
    stamps = [pair.stamp_ns for pair in log.pairs()]
    return stamps, log.stats.warnings, log.stats.complete


def change(base: Base, path: Path, at: int, replacement: bytes) -> None:
    data = bytearray(base.data)
    data[at : at + len(replacement)] = replacement
    path.write_bytes(data)


@pytest.mark.parametrize("length", [0, 7, 5000, 2**40, 2**64 - 1])
def test_a_wrong_length_of_a_chunk_costs_nothing(length: int, path: Path, tmp_path: Path):
    """It is given a second time inside the chunk, and the checksum confirms it."""
    base = make_base("ROS 2, zstd", tmp_path)
    broken = [r for r in base.records if r.opcode == Opcode.CHUNK][2]
    change(base, path, broken.start + 1, struct.pack("<Q", length))
    found, warnings, complete = read(path)
    assert found == list(base.frame_ends) and complete
    assert f"byte {broken.start}: a chunk was read although its length, {length}, is wrong" in " ".join(warnings)


def test_an_end_in_the_middle_is_no_end(path: Path, tmp_path: Path):
    base = make_base("protobuf, no index", tmp_path)
    data_end = next(r for r in base.records if r.opcode == Opcode.DATA_END)
    footer = base.data[data_end.end : -8]
    chunk = [r for r in base.records if r.opcode == Opcode.CHUNK][3]
    for inserted in (base.data[data_end.start : data_end.end], footer):
        path.write_bytes(base.data[: chunk.start] + inserted + base.data[chunk.start :])
        assert read(path)[0] == list(base.frame_ends)


def test_a_message_that_the_index_counts_and_nobody_finds_is_missed(path: Path, tmp_path: Path):
    """A flipped bit makes an unknown record of a message, and readers pass over unknown records."""
    base = make_base("protobuf, unchunked", tmp_path)
    last = [r for r in base.records if r.opcode == Opcode.MESSAGE][-1]
    change(base, path, last.start, b"\x85")
    found, warnings, complete = read(path)
    assert found == list(base.frame_ends)[:-1] and not complete
    assert f"{path}: 4 of 5 messages of /camera/right/image could be read" in warnings


def test_an_index_without_a_checksum_that_leads_astray_is_left(path: Path, tmp_path: Path):
    base = make_base("ROS 1, uncompressed chunks without checksums", tmp_path)
    at = base.data.rindex(b"/camera/right/image")
    change(base, path, at, b"/camera/wrong/image")
    found, warnings, complete = read(path)
    assert found == list(base.frame_ends) and complete
    assert "its index is not used: it carries no checksum" in warnings[0]


def test_an_index_with_a_wrong_checksum_is_not_used_and_nothing_is_lost(path: Path, tmp_path: Path):
    base = make_base("ROS 2, zstd", tmp_path)
    at = base.data.rindex(b"/camera/right/image")
    change(base, path, at, b"/camera/wrong/image")
    assert LogFile(path).index is None
    found, warnings, complete = read(path)
    assert found == list(base.frame_ends) and complete
    assert warnings == [f"{path}: its index is not used: its checksum does not match its content"]


def test_records_of_gigabytes_are_passed_over_unread(path: Path):
    """A sparse file: the lengths are true, the bytes are not there."""
    write_log(path, Spec(), use_chunking=False)
    data = path.read_bytes()
    head = 8 + 9 + struct.unpack_from("<Q", data, 9)[0]
    huge = 2**32
    with path.open("r+b") as stream:
        for n in range(3):
            stream.seek(head + n * (huge + 9))
            stream.write(struct.pack("<BQ", Opcode.MESSAGE, huge))
        stream.seek(head + 3 * (huge + 9))
        stream.write(data[head:])
    found, warnings, complete = read(path)
    assert len(found) == 12 and not complete
    assert sum("a record of 4096 MiB was skipped" in w for w in warnings) == 3


def test_notes_of_damage_stay_few(path: Path):
    write_log(path, Spec(), use_chunking=False)
    data = path.read_bytes()
    head = 8 + 9 + struct.unpack_from("<Q", data, 9)[0]
    stray = struct.pack("<BQHIQQ", Opcode.MESSAGE, 22, 999, 0, 0, 0)
    path.write_bytes(data[:head] + 5000 * stray + data[head:])
    damage = Damage()
    assert sum(1 for _ in LogFile(path).messages(damage)) == 26
    assert not damage.complete and 1 < len(damage.notes) < 30  # of 5000 stray records


def test_channels_without_a_schema_are_passed_over_unless_they_are_the_cameras(path: Path):
    log = LogWriter(path)
    bare = log.writer.register_channel("/camera/left/image_raw", "json", 0)
    for n in range(4):
        time = START_NS + n * PERIOD_NS
        log.writer.add_message(bare, time, b"{}", time)
        for side, topic in enumerate(Spec.topics):
            write_image(log, "foxglove", topic, time, scene(n, side), "png")
    log.close()
    rig = sfm.open_log(write_log(path.with_name("whole.mcap"))).rig
    assert len(list(sfm.open_log(path, calibration=rig).frames())) == 4
    with pytest.raises(sfm.LogError, match="/camera/left/image_raw is not an image topic"):
        sfm.open_log(path, left="/camera/left/image_raw", right=Spec.topics[1], calibration=rig)
