"""The schemas and channels that a file declares, within the memory that a real recording can need.

They are kept while a file is read, and a compressed chunk of a few kilobytes can hold a hundred megabytes of them.
"""

from copy import copy
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Channel as ChannelRecord
from mcap.records import Schema

from ...system.inputs import LIMITS
from .message import Channel
from .records import BrokenRecord, RecordTooLarge, parse_record


class Definitions:
    """`schemas` and `channels` by id."""

    def __init__(self) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, ChannelRecord] = {}
        self._described: dict[int, tuple[ChannelRecord, Schema | None, Channel]] = {}
        self._bytes = 0

    def copy(self) -> "Definitions":
        """Return a copy with its own dictionaries."""
        other = copy(self)
        other.schemas, other.channels, other._described = dict(self.schemas), dict(self.channels), {}
        return other

    def add(self, opcode: int, body: bytes | memoryview, replace: bool = True) -> None:
        """Add the schema or channel of one record; a known one costs no memory.

        Raises BrokenRecord if it is damaged or, without `replace`, differs from one of the same number, and
        RecordTooLarge if it exceeds the limits.
        """
        if len(body) > LIMITS.definition_bytes:
            raise RecordTooLarge(f"a schema or channel of {len(body) / 2**20:.0f} MiB")
        known: dict[int, Any] = self.schemas if opcode == Opcode.SCHEMA else self.channels
        record = parse_record(Schema.read if opcode == Opcode.SCHEMA else ChannelRecord.read, body)
        if known.get(record.id) == record:
            return
        if record.id in known and not replace:
            raise BrokenRecord("it differs from the definition of the same number")
        size_bytes = len(body) + LIMITS.object_bytes * (1 + len(getattr(record, "metadata", ())))
        if self._bytes + size_bytes > LIMITS.definitions_bytes:
            raise RecordTooLarge(f"more than {LIMITS.definitions_bytes // 2**20} MiB of schemas and channels")
        self._bytes += size_bytes
        known[record.id] = record

    def channel(self, channel_id: int) -> Channel:
        """Return a channel with its schema; the same object as long as neither changes."""
        found = self.channels[channel_id]
        schema = self.schemas.get(found.schema_id)
        known = self._described.get(channel_id)
        if known is None or known[0] is not found or known[1] is not schema:
            of_schema = (schema.name, schema.encoding, schema.data) if schema else ("", "", b"")
            described = Channel(found.topic, found.message_encoding, *of_schema, tuple(found.metadata.items()))
            known = self._described[channel_id] = found, schema, described
        return known[2]

    def add_missing(self, others: "Definitions") -> None:
        """Add other definitions with unused numbers; their memory is already counted there."""
        self.schemas = others.schemas | self.schemas
        self.channels = others.channels | self.channels
