"""ROS 2 bags in SQLite files (`.db3`), the storage of ROS 2 before MCAP.

The reader of `rosbags` is not used: it ignores the journal of an interrupted recorder, executes whatever a file
declares as its tables, and sorts all messages.
"""

import os
import sqlite3
import weakref
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

from mcap.well_known import MessageEncoding

from ....errors import LogError, as_error
from ....system.inputs import LIMITS, open_regular, reading
from ...mcap_file.message import Channel, Contents, Damage, Message, Source
from . import Container

_TABLES = ("topics", "messages", "message_definitions")  # the last table exists since ROS 2 Iron
_JOURNALS = ("-journal", "-wal")  # files beside the database, with changes that are not in it
# Instructions that SQLite may take for one query: as many as the rows of the file can need, and some seconds.
_STEP, _FREE_STEPS, _STEPS_PER_BYTE = 1_000, 100_000_000, 10


class SqliteBagSource(Source):
    """The messages of one `.db3` file, in the order of recording. Raises LogError if it is not a bag."""

    format, profile = "ROS 2 bag (SQLite)", "ros2"

    def __init__(self, path: str | Path, database: sqlite3.Connection | None = None, size_bytes: int = 0) -> None:
        """Open a bag; `database`: connected to the decompressed copy, of this size, of the file at `path`."""
        self.path, self.size_bytes = Path(path), size_bytes
        self._journal = ""  # what is wrong with the file without its journal
        with as_error(LogError, f"{self.path} is not a ROS 2 bag, or is damaged", sqlite3.Error):
            if database is None:
                with reading(self.path), open_regular(self.path) as stream:
                    self.size_bytes = os.fstat(stream.fileno()).st_size
                database = self._connect()
            self._database = database
            weakref.finalize(self, database.close)
            # a file that is shorter than its header says is only cut off
            database.execute("PRAGMA writable_schema = ON")
            self._check_tables()
            self._channels = self._read_channels()

    def _connect(self) -> sqlite3.Connection:
        """Connect read-only; `immutable` if SQLite may not create lock files, or would have to complete the file."""
        for option in ("mode=ro", "mode=ro&immutable=1"):
            database = connect(self.path, option)
            try:
                database.execute("PRAGMA writable_schema = ON")
                database.execute("SELECT name FROM sqlite_master LIMIT 1").fetchall()
                if "immutable" in option and (left := [j for j in _JOURNALS if _has_content(f"{self.path}{j}")]):
                    self._journal = (
                        f"{self.path}: its recorder was interrupted, and {self.path.name}{left[0]} beside it holds "
                        "changes that were not used: open and close the file with `sqlite3` to complete it"
                    )
                return database
            except sqlite3.Error as error:
                database.close()
                failure = error
        raise failure

    def _check_tables(self) -> None:
        """Raise sqlite3.Error if a table is a view or anything else with computed content."""
        marks = ",".join("?" * len(_TABLES))
        query = f"SELECT name, type, substr(sql, 1, 12) FROM sqlite_master WHERE name IN ({marks})"
        for name, kind, sql in self._rows(query, _TABLES):
            computed = kind != "table" or sql != "CREATE TABLE"
            if computed or any(row[6] > 1 for row in self._rows(f"PRAGMA table_xinfo({name})")):
                raise sqlite3.DatabaseError(f"{name} is not a plain table")

    def _rows(self, query: str, values: tuple[Any, ...] | list[Any] = ()) -> Iterator[Any]:
        """Yield the rows of a query. Raises sqlite3.Error, also if it takes more work than the file can need."""
        left = (_FREE_STEPS + _STEPS_PER_BYTE * self.size_bytes) // _STEP

        def out_of_steps() -> bool:
            nonlocal left
            left -= 1
            return left < 0

        self._database.set_progress_handler(out_of_steps, _STEP)
        return iter(self._database.execute(query, values))

    def _read_channels(self) -> dict[int, Channel]:
        definitions: dict[str, tuple[str, bytes]] = {}
        if next(self._rows("SELECT 1 FROM sqlite_master WHERE name = ?", _TABLES[2:]), None):
            query = (
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions "
                f"WHERE length(topic_type) <= {LIMITS.name} "
                f"AND length(encoded_message_definition) <= {LIMITS.ros_definition_bytes} LIMIT {LIMITS.named}"
            )
            for kind, encoding, text in self._rows(query):
                if text and _are_text(encoding, text):
                    definitions[kind] = encoding, text.encode()
        channels = {}
        query = (
            "SELECT id, name, type, serialization_format FROM topics "
            f"WHERE length(name) <= {LIMITS.name} AND length(type) <= {LIMITS.name} LIMIT {LIMITS.named}"
        )
        for number, topic, kind, encoding in self._rows(query):
            if not _are_text(topic, kind, encoding or ""):
                continue  # SQLite stores values of any type, whatever the type of the column
            schema_encoding, definition = definitions.get(kind) or ("ros2msg", _standard_definition(kind))
            channels[number] = Channel(topic, encoding or MessageEncoding.CDR, kind, schema_encoding, definition)
        return channels

    def contents(self) -> Contents | None:
        """Return the counts from the table of messages, without reading their images; None if it is damaged."""
        counts: dict[int, int] = {}
        spans_ns: list[int] = []
        query = (
            "SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp) FROM messages "
            "WHERE typeof(timestamp) = 'integer' GROUP BY topic_id"
        )
        try:
            for number, count, first_ns, last_ns in self._rows(query):
                if number in self._channels:
                    counts[number] = count
                    spans_ns += (first_ns, last_ns)
        except sqlite3.Error:
            return None
        channels = [(channel, counts.get(number, 0)) for number, channel in self._channels.items()]
        return Contents(channels, min(spans_ns, default=0), max(spans_ns, default=0))

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all); in a damaged database, those before the damage."""
        if self._journal:
            damage.add(self._journal)
        wanted = [n for n, channel in self._channels.items() if topics is None or channel.topic in topics]
        marks = ",".join("?" * len(wanted))
        data = f"CASE WHEN length(data) <= {LIMITS.record_bytes} THEN data END"
        # By row number, which is the order of recording, so that nothing has to be sorted.
        query = f"SELECT topic_id, timestamp, {data} FROM messages WHERE topic_id IN ({marks}) ORDER BY rowid"
        read = 0
        try:
            for number, log_time_ns, content in self._rows(query, wanted):
                if not isinstance(log_time_ns, int) or not isinstance(content, bytes):
                    what = "messages that are not bytes with a time, or over 128 MiB, were skipped"
                    damage.add(f"{self.path}: {what}")
                    continue
                read += 1
                damage.bytes_read += len(content)
                yield Message(self._channels[number], log_time_ns, content)
        except sqlite3.Error as error:
            damage.add(f"{self.path}: reading failed after {read} messages: {error}")
        else:
            damage.bytes_read = self.size_bytes


def connect(path: Path, option: str) -> sqlite3.Connection:
    """Return a connection to a database, which any thread may use."""
    uri = f"file:{quote(str(path.absolute()))}?{option}"
    database = sqlite3.connect(uri, uri=True, check_same_thread=False)
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, 2 * LIMITS.record_bytes)  # of a row; each image has its own limit
    return database


def _has_content(path: str) -> bool:
    return os.path.isfile(path) and os.path.getsize(path) > 0


def _are_text(*values: object) -> bool:
    return all(isinstance(value, str) for value in values)


@lru_cache(maxsize=64)
def _standard_definition(schema_name: str) -> bytes:
    """Return ROS 2's definition of a message type and of its parts, for bags without definitions; else empty."""
    from rosbags.typesys import Stores, get_typestore

    # Messages of cameras, poses and transforms are the same in all distributions of ROS 2.
    store = get_typestore(Stores.ROS2_HUMBLE)
    if schema_name not in store.fielddefs:
        return b""
    text, _ = store.generate_msgdef(schema_name, ros_version=2)
    return text.encode()


CONTAINER = Container(SqliteBagSource, rb"SQLite format 3\0", ".db3", "a ROS 2 bag")
