"""Recordings of other kinds than MCAP that ask for hours, gigabytes or files: work and memory are counted."""

import os
import signal
import sqlite3
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
import zstandard

import stream_sfm as sfm
from stream_sfm.mcap_file.damage import Damage
from stream_sfm.mcap_file.log_file import LogFile
from stream_sfm.sources import ros1_bag
from tests.faults.records import MIB, bag_chunk, bag_message, bag_record
from tests.helpers.bags import messages_of, write_bag1, write_bag2
from tests.helpers.memory import peaks_mib
from tests.helpers.stereo_logs import CONTAINERS, Spec, write_log

MAX_MIB = 500  # of a process, which takes about a hundred with NumPy, OpenCV and the libraries of messages


def refused_or_read(path: Path) -> str:
    """What is said of a recording that is opened and read."""
    try:
        log = sfm.open_log(path)
        list(log.pairs())
    except sfm.LogError as error:
        return str(error)
    return " ".join(log.stats.warnings)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """The folder of a ROS 2 bag in SQLite."""
    folder = tmp_path_factory.mktemp("bag")
    return write_bag2(folder / "walk", messages_of(write_log(folder / "log.mcap", Spec(profile="ros2"))))


def copied(bag: Path, folder: Path) -> Path:
    (folder / "walk.db3").write_bytes((bag / "walk.db3").read_bytes())
    return folder / "walk.db3"


@pytest.mark.parametrize(
    "metadata",
    [
        "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(f"b{n}: &b{n} [*a, *a, *a]\n" for n in range(30)),
        "rosbag2_bagfile_information:\n  relative_file_paths: 5\n",
        "rosbag2_bagfile_information:\n  relative_file_paths:\n    - *a\n",
        "rosbag2_bagfile_information:\n  relative_file_paths: &a [*a, *a]\n",
        "rosbag2_bagfile_information:\n  relative_file_paths:\n" + "    - a.db3\n" * 20_000,
        "[" * 100_000,
    ],
)
def test_metadata_that_is_not_a_list_of_files_leaves_the_files(bag, tmp_path, metadata):
    copied(bag, tmp_path)
    (tmp_path / "metadata.yaml").write_text(metadata)
    log = sfm.open_log(tmp_path)
    assert len(list(log.pairs())) == 12
    assert "metadata.yaml is not used" in log.stats.warnings[0]


ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS id, "


@pytest.mark.parametrize(
    "change",
    [
        f"DROP TABLE messages; CREATE VIEW messages AS {ENDLESS}1 AS topic_id, i AS timestamp, x'00' AS data FROM n",
        f"DROP TABLE topics; CREATE VIEW topics AS {ENDLESS}'/a' AS name, 'a/msg/B' AS type, 'cdr' AS"
        " serialization_format FROM n",
        "DROP TABLE message_definitions; CREATE VIEW message_definitions AS "
        f"{ENDLESS}'a' AS topic_type, 'b' AS encoding, 'c' AS encoded_message_definition FROM n",
        "DROP TABLE messages; CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp,"
        " data BLOB AS (zeroblob(1000000000)))",
        "DROP TABLE messages; CREATE VIRTUAL TABLE messages USING fts5(topic_id, timestamp, data)",
    ],
)
def test_only_plain_tables_are_read(bag, tmp_path, change):
    path = copied(bag, tmp_path)
    with closing(sqlite3.connect(path)) as database:
        database.executescript(change)
    with pytest.raises(sfm.LogError, match="is not a plain table"):
        sfm.open_log(path)


def test_the_journal_of_an_interrupted_recorder_is_told(bag, tmp_path):
    """As a recorder leaves it that is killed within a transaction: pages are changed, and the journal has the old."""
    path = copied(bag, tmp_path)
    code = """
import os, sqlite3, sys
database = sqlite3.connect(sys.argv[1], isolation_level=None)
database.execute("PRAGMA cache_size = 1")
database.execute("BEGIN")
database.execute("UPDATE messages SET timestamp = timestamp + 1")
os.kill(os.getpid(), 9)
"""
    assert subprocess.run([sys.executable, "-c", code, str(path)], check=False).returncode == -signal.SIGKILL
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    assert set(before) == {"walk.db3", "walk.db3-journal"}
    log = sfm.open_log(path)
    assert len(list(log.pairs())) == 12 and not log.stats.complete
    assert "walk.db3-journal beside it holds changes that were not used" in " ".join(log.stats.warnings)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (bytes(8 * MIB), "there is no record (zeros, or damage)"),
        (bag_message(999) * 100_000, "a message of a connection that is not described"),
        (bag_message(0) * 100_000, "it holds more records than bytes"),
    ],
)
def test_a_chunk_of_few_bytes_costs_little_work(tmp_path, monkeypatch, content, says):
    """16 million empty records in 160 bytes took 75 s."""
    monkeypatch.setattr("stream_sfm.mcap_file.chunks._FREE_RECORDS", 10_000)
    path = write_bag1(tmp_path / "a.bag", messages_of(write_log(tmp_path / "l.mcap", Spec(profile="ros1"))))
    data = path.read_bytes()
    index_at = data.split(b"index_pos=")[1][:8]
    path.write_bytes(data.replace(index_at, bytes(8), 1) + bag_chunk(content))
    log = sfm.open_log(path)
    assert len(list(log.pairs())) == 12 and not log.stats.complete
    assert f"a damaged record was skipped: {says}" in log.stats.warnings[0]


def _first_record_end(data: bytes) -> int:
    at = len(ros1_bag.MAGIC)
    header = int.from_bytes(data[at : at + 4], "little")
    length = int.from_bytes(data[at + 4 + header : at + 8 + header], "little")
    return at + 8 + header + length


def test_chunks_of_a_bag_expand_to_no_more_than_a_bag_could_hold(tmp_path, monkeypatch):
    monkeypatch.setattr("stream_sfm.sources.ros1_bag._FREE_BYTES", 10 * MIB)
    path = write_bag1(tmp_path / "a.bag", messages_of(write_log(tmp_path / "l.mcap", Spec(profile="ros1"))))
    data = path.read_bytes()
    end = _first_record_end(data)
    path.write_bytes(data[:end] + bag_chunk(bytes(20 * MIB)) * 3 + data[end:])
    said = refused_or_read(path)
    assert "declare over 1000 times as many" in said


def test_compressed_splits_together_hold_no_more_than_a_bag(tmp_path, monkeypatch):
    monkeypatch.setattr("stream_sfm.sources.rosbag2._FREE_BYTES", 40 * MIB)
    bomb = zstandard.compress(bytes(30 * MIB))
    for n in range(6):
        (tmp_path / f"walk_{n}.mcap.zstd").write_bytes(bomb)
    with pytest.raises(sfm.LogError, match="far more than a recording"):
        sfm.open_log(tmp_path)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_nothing_is_left_of_a_compressed_bag_however_its_reader_ends(tmp_path, storage):
    messages = messages_of(write_log(tmp_path / "log.mcap", Spec(profile="ros2")))
    walk = write_bag2(tmp_path / "walk", messages, storage, "file")
    (copies := tmp_path / "copies").mkdir()
    code = """
import sys
import stream_sfm as sfm
log = sfm.open_log(sys.argv[1])
pairs = log.pairs()
next(pairs)
print("reading", flush=True)
sys.stdin.read()
"""
    with subprocess.Popen(
        [sys.executable, "-c", code, str(walk)],
        env=os.environ | {"TMPDIR": str(copies)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as reader:
        assert reader.stdout is not None and reader.stdout.readline() == "reading\n"
        assert not list(copies.iterdir())
        reader.kill()
    assert reader.returncode == -signal.SIGKILL and not list(copies.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("line", [b"1.5\n", b"0.1 " * 16])
def test_a_text_of_millions_of_stamps_is_refused_in_little_memory(tmp_path, line):
    path = tmp_path / "times.txt"
    path.write_bytes(line * (48 * MIB // len(line)))
    code = """
from pathlib import Path
import stream_sfm as sfm
from stream_sfm.sources.pose_files import read_poses, read_times
for read in (read_times, read_poses):
    try:
        read(Path(sys.argv[1]))
    except sfm.LogError as error:
        assert "is it another file" in str(error) or "columns" in str(error) or "time" in str(error), error
"""
    assert max(peaks_mib(code, path)) < MAX_MIB


def bag_of_topics(names: Iterator[bytes]) -> bytes:
    """A ROS 1 bag without an index, with connections of these names."""
    header = bag_record(
        {"op": b"\x03", "index_pos": bytes(8), "conn_count": bytes(4), "chunk_count": bytes(4)}, b""
    )
    kind = b"type=sensor_msgs/Image"
    description = struct.pack("<I", len(kind)) + kind
    records = (
        bag_record({"op": b"\x07", "conn": struct.pack("<I", n), "topic": name}, description) + bag_message(n)
        for n, name in enumerate(names)
    )
    return ros1_bag.MAGIC + header + b"".join(records)


@pytest.mark.slow
@pytest.mark.parametrize(
    "names",
    [(b"/cam%d/left/image" % n for n in range(20_000)), (b"/%d" % n + b"/left" * 13_000 for n in range(100))],
    ids=["many", "long"],
)
def test_inspecting_very_many_or_very_long_topics_takes_little(tmp_path, names):
    path = tmp_path / "a.bag"
    path.write_bytes(bag_of_topics(names))
    code = """
import stream_sfm as sfm
report = sfm.inspect(sys.argv[1])
assert len(report["topics"]) <= 4096, len(report["topics"])
assert any("only 4096 topics" in w for w in report["warnings"]), report["warnings"]
"""
    assert max(peaks_mib(code, path)) < MAX_MIB


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
    assert file.header() is None or share
    list(file.attachments(Damage()))
