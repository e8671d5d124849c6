"""Everything readable of a damaged file is recovered unchanged, in a file that every reader opens."""

from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

import stream_sfm as sfm
from stream_sfm.logs.mcap_file.log_file import LogFile
from stream_sfm.logs.mcap_file.message import Damage
from tests.faults.damage import INDEXES, KINDS, trial, whole_log
from tests.helpers.stereo_logs import CONTAINERS, Spec, write_log


def everything(path: Path) -> list[tuple[object, ...]]:
    """All that a file holds, by the mcap library."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found: list[tuple[object, ...]] = [
            (c.topic, c.message_encoding, c.metadata, s and (s.name, s.encoding, s.data), m.log_time, m.publish_time,
             m.sequence, m.data)
            for s, c, m in reader.iter_messages(log_time_order=False)
        ]  # fmt: skip
        found += [(a.name, a.media_type, a.create_time, a.log_time, a.data) for a in reader.iter_attachments()]
        return found + [(m.name, m.metadata) for m in reader.iter_metadata()]


def write_all_kinds(path: Path, chunked: bool) -> None:
    """Topics with and without schema, metadata of a channel and of the file, attachments, sequence numbers."""
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=60, use_chunking=chunked, compression=CompressionType.LZ4)
        writer.start("ros2", "tests")
        schema = writer.register_schema("pkg/msg/Kind", "ros2msg", b"int32 x")
        channels = [
            writer.register_channel("/a", "cdr", schema, {"offered_qos_profiles": "- history: 1"}),
            writer.register_channel("/b", "json", 0),
            writer.register_channel("/a", "cdr", schema, {"offered_qos_profiles": "- history: 2"}),
        ]
        for n in range(30):
            writer.add_message(channels[n % 3], 1000 - n, bytes([n]) * n, 7 + n, 100 + n)
        writer.add_attachment(1, 2, "rig.toml", "text/plain", b"[left]")
        writer.add_metadata("session", {"place": "hall"})
        writer.finish()


@pytest.mark.parametrize("chunked", [True, False])
def test_of_a_whole_file_everything_is_copied(path: Path, tmp_path: Path, chunked: bool) -> None:
    write_all_kinds(path, chunked)
    recovered = sfm.recover(path, tmp_path / "new" / "out.mcap")
    assert everything(recovered.path) == everything(path) and len(everything(path)) == 32
    assert recovered.complete and not recovered.warnings
    assert recovered.messages == {"/a": 20, "/b": 10}
    assert (recovered.attachments, recovered.metadata) == (1, 1)
    assert LogFile(recovered.path).profile == "ros2"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("index", INDEXES)
def test_of_a_damaged_file_what_is_read_is_copied(path: Path, tmp_path: Path, kind: str, index: str) -> None:
    whole = whole_log(write_log(tmp_path / "whole.mcap", Spec(), **CONTAINERS["zstd"]))
    assert any(trial(whole, index, kind, seed, path).found for seed in range(9))  # the first that leaves a description
    damage = Damage()
    readable = [(m.channel.topic, m.log_time_ns, m.data) for m in LogFile(path).messages(damage)]
    recovered = sfm.recover(path, tmp_path / "out.mcap")
    with recovered.path.open("rb") as stream:
        copied = [
            (c.topic, m.log_time, m.data)
            for _, c, m in make_reader(stream, validate_crcs=True).iter_messages(log_time_order=False)
        ]
    assert copied == readable and copied
    assert recovered.complete == damage.complete
    again = sfm.recover(recovered.path, tmp_path / "again.mcap")
    assert again.complete and not again.warnings and again.messages == recovered.messages


def test_the_start_may_be_damaged(path: Path, tmp_path: Path) -> None:
    write_log(path, Spec(), **CONTAINERS["zstd"])
    data = bytearray(path.read_bytes())
    data[:30] = bytes(30)
    path.write_bytes(data)
    recovered = sfm.recover(path, tmp_path / "out.mcap")
    assert sum(recovered.messages.values()) == 26
    assert "its first bytes are not those of an MCAP file" in recovered.warnings[0]
    assert len(list(sfm.open_log(path).pairs())) == 12


def test_the_command_says_what_was_lost(path: Path, tmp_path: Path, cli) -> None:
    write_log(path, Spec(), **CONTAINERS["zstd"])
    whole = path.read_bytes()
    out = tmp_path / "out.mcap"
    assert "26 messages; nothing was lost" in cli("recover", path, out).out
    path.write_bytes(whole[: len(whole) // 2])
    assert "use --force" in cli("recover", path, out, code=3).err
    printed = cli("recover", path, out, "--force", "--json", code=3).json
    assert not printed["complete"] and 4 < sum(printed["messages"].values()) < 26  # half of the file was left
    said = cli("recover", path, out, "--force", "-q", code=3)
    assert said.out == "" and "is cut off or damaged at byte" in said.err


def test_a_link_to_nothing_is_not_replaced(path: Path, tmp_path: Path) -> None:
    write_log(path, Spec())
    out = tmp_path / "out.mcap"
    out.symlink_to(tmp_path / "nothing")
    with pytest.raises(sfm.OutputError, match="exists already"):
        sfm.recover(path, out)
    assert out.is_symlink() and not (tmp_path / "nothing").exists()


def test_nothing_is_left_where_nothing_can_be_read(path: Path, tmp_path: Path) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.finish()
    with pytest.raises(sfm.LogError, match="no message that can be read"):
        sfm.recover(path, tmp_path / "out.mcap")
    path.write_bytes(b"\x89PNG" + bytes(100))
    with pytest.raises(sfm.LogError, match="is not an MCAP file"):
        sfm.recover(path, tmp_path / "out.mcap")
    assert [p.name for p in tmp_path.iterdir()] == ["log.mcap"]


def test_an_interrupted_copy_leaves_nothing(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_log(path, Spec())

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Writer, "add_message", interrupted)
    with pytest.raises(KeyboardInterrupt):
        sfm.recover(path, tmp_path / "out.mcap")
    assert [p.name for p in tmp_path.iterdir()] == ["log.mcap"]
