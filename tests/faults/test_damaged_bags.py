"""Bags with damaged bytes give frames, or an error that names the file, in bounded memory, whatever the damage."""

import random
import re
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

import stream_sfm as sfm
from tests.faults.attacks import changed, write_bags
from tests.helpers.stereo_logs import PERIOD_NS, START_NS

STAMPS_NS = {START_NS + n * PERIOD_NS for n in range(12)}
SEEDS = 60


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """The content of a bag of each kind."""
    *files, folder, _ = write_bags(tmp_path_factory.mktemp("bags"))
    return {path.name: path.read_bytes() for path in files} | {"walk.db3": (folder / "bag_0.db3").read_bytes()}


@pytest.mark.parametrize("name", ["none.bag", "bz2.bag", "lz4.bag", "walk.db3"])
def test_damage_costs_what_it_hits_and_nothing_else_is_raised(name, bags, tmp_path):
    path = tmp_path / name
    whole = 0
    for seed in range(SEEDS):
        path.write_bytes(changed(random.Random(seed), bags[name]))
        try:
            log = sfm.open_log(path)
            stamps = [pair.stamp_ns for pair in log.pairs()]
        except sfm.LogError as error:
            assert str(path) in str(error) and "\n" not in str(error), seed
            continue
        assert stamps == sorted(set(stamps)), seed
        whole += set(stamps) == STAMPS_NS
        assert log.stats.complete or log.stats.warnings, seed
    assert 0 < whole < SEEDS


def database(path: Path, content: bytes, change: str) -> Path:
    path.write_bytes(content)
    with closing(sqlite3.connect(path)) as opened:
        opened.executescript(change)
    return path


ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS id, "
OTHER_TYPES = [  # SQLite stores what it is given, whatever the type of the column
    "UPDATE messages SET data = 'text'",
    "UPDATE messages SET data = 7",
    "UPDATE messages SET topic_id = 99",
    "UPDATE messages SET timestamp = 'soon'",
    "UPDATE topics SET name = x'ff00'",
    "UPDATE topics SET type = 5",
    "UPDATE topics SET serialization_format = 3",
    "UPDATE message_definitions SET encoding = 3",
    "DROP TABLE messages",
    "ALTER TABLE messages RENAME COLUMN data TO bytes",
]
COMPUTED = [
    f"DROP TABLE messages; CREATE VIEW messages AS {ENDLESS}1 AS topic_id, i AS timestamp, x'00' AS data FROM n",
    f"DROP TABLE topics; CREATE VIEW topics AS {ENDLESS}'/a' AS name, 'a/msg/B' AS type, 'cdr' AS"
    " serialization_format FROM n",
    "DROP TABLE message_definitions; CREATE VIEW message_definitions AS "
    f"{ENDLESS}'a' AS topic_type, 'b' AS encoding, 'c' AS encoded_message_definition FROM n",
    "DROP TABLE messages; CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp,"
    " data BLOB AS (zeroblob(1000000000)))",
    "DROP TABLE messages; CREATE VIRTUAL TABLE messages USING fts5(topic_id, timestamp, data)",
]


@pytest.mark.parametrize("change", [*OTHER_TYPES, *COMPUTED])
def test_a_database_of_other_types_or_tables_is_refused(change, bags, tmp_path):
    path = database(tmp_path / "walk.db3", bags["walk.db3"], change)
    with pytest.raises(sfm.LogError, match=re.escape(str(path))) as refused:
        list(sfm.open_log(path).pairs())
    assert change in OTHER_TYPES or "is not a plain table" in str(refused.value)


def test_definitions_that_are_no_text_are_those_of_the_distribution(bags, tmp_path):
    change = "UPDATE message_definitions SET encoded_message_definition = x'00'"
    path = database(tmp_path / "walk.db3", bags["walk.db3"], change)
    assert {pair.stamp_ns for pair in sfm.open_log(path).pairs()} == STAMPS_NS


def test_the_journal_of_an_interrupted_recorder_is_reported(bags, tmp_path):
    """As a recorder leaves it that is killed within a transaction: pages are changed, and the journal has the old."""
    path = tmp_path / "walk.db3"
    path.write_bytes(bags["walk.db3"])
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
def test_metadata_that_is_not_a_list_of_files_leaves_the_files(bags, tmp_path, metadata):
    (tmp_path / "walk.db3").write_bytes(bags["walk.db3"])
    (tmp_path / "metadata.yaml").write_text(metadata)
    log = sfm.open_log(tmp_path)
    assert {pair.stamp_ns for pair in log.pairs()} == STAMPS_NS
    assert "metadata.yaml is not used" in log.stats.warnings[0]
