"""ROS 2 bags in SQLite files (`.db3`), the storage of ROS 2 before MCAP."""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote

from mcap.well_known import MessageEncoding

from ..errors import LogError
from ..inputs import open_regular
from ..mcap_file.damage import Damage
from ..mcap_file.records import MAX_RECORD_BYTES
from .ros_definitions import standard_definition
from .source import Attachment, Channel, Contents, Message

MAGIC = b"SQLite format 3\0"


class SqliteBagSource:
    """The messages of one `.db3` file, in the order of recording. Raises LogError where it is not a bag."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        try:
            with open_regular(self.path) as stream:
                self.size_bytes = os.fstat(stream.fileno()).st_size
            with closing(self._connect()) as database:
                self._channels = self._read_channels(database)
        except OSError as error:
            raise LogError(f"cannot read {self.path}: {error.strerror}") from None
        except sqlite3.Error as error:
            raise LogError(f"{self.path} is not a ROS 2 bag, or is damaged: {error}") from None

    def _connect(self) -> sqlite3.Connection:
        """Read only; `immutable` where the folder does not even let SQLite make its lock files.

        With `writable_schema`, SQLite takes a file that is shorter than its header says for what it is: cut off.
        """
        for option in ("mode=ro", "mode=ro&immutable=1"):
            database = sqlite3.connect(f"file:{quote(str(self.path.absolute()))}?{option}", uri=True)
            try:
                database.execute("PRAGMA writable_schema = ON")
                database.execute("SELECT id FROM topics LIMIT 1").fetchall()
                return database
            except sqlite3.Error as error:
                database.close()
                failure = error
        raise failure

    def _read_channels(self, database: sqlite3.Connection) -> dict[int, Channel]:
        tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        definitions: dict[str, tuple[str, bytes]] = {}
        if "message_definitions" in tables:  # since ROS 2 Iron
            rows = database.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            )
            definitions = {
                kind: (encoding, text.encode())
                for kind, encoding, text in rows
                if text and _are_text(encoding, text)
            }
        channels = {}
        for number, topic, kind, encoding in database.execute(
            "SELECT id, name, type, serialization_format FROM topics"
        ):
            if not _are_text(topic, kind, encoding or ""):
                continue  # SQLite stores what it is given, whatever the type of the column
            schema_encoding, definition = definitions.get(kind) or ("ros2msg", standard_definition(kind))
            channels[number] = Channel(topic, encoding or MessageEncoding.CDR, kind, schema_encoding, definition)
        return channels

    def contents(self) -> Contents | None:
        """Counted in the table of messages, whose images need not be read for it; None where that is damaged."""
        counts: dict[int, int] = {}
        spans = []
        try:
            with closing(self._connect()) as database:
                for number, count, first_ns, last_ns in database.execute(
                    "SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp) FROM messages "
                    "WHERE typeof(timestamp) = 'integer' GROUP BY topic_id"
                ):
                    counts[number] = count
                    spans.append((first_ns, last_ns))
        except sqlite3.Error:
            return None
        contents = Contents([(channel, counts.get(number, 0)) for number, channel in self._channels.items()])
        if spans:
            contents.start_ns, contents.end_ns = min(s for s, _ in spans), max(e for _, e in spans)
        return contents

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all); where the database is damaged, those before the damage."""
        wanted = [n for n, channel in self._channels.items() if topics is None or channel.topic in topics]
        marks = ",".join("?" * len(wanted))
        data = f"CASE WHEN length(data) <= {MAX_RECORD_BYTES} THEN data END"
        query = f"SELECT topic_id, timestamp, {data} FROM messages WHERE topic_id IN ({marks}) ORDER BY id"
        read = 0
        try:
            with closing(self._connect()) as database:
                for number, log_time_ns, content in database.execute(query, wanted):
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

    def attachments(self, damage: Damage) -> Iterator[Attachment]:
        """SQLite bags have no attachments."""
        return iter(())

    def description(self) -> dict[str, Any]:
        """See `Source`."""
        return {"format": "ROS 2 bag (SQLite)", "profile": "ros2", "library": None, "indexed": True}

    def drop_unverified_index(self) -> bool:
        """See `Source`; the database has no other index than itself."""
        return False


def _are_text(*values: object) -> bool:
    return all(isinstance(value, str) for value in values)
