"""ROS 1 bags (format 2.0), read in file order: one path for indexed, unindexed, damaged and cut-off files.

A bag is a sequence of records, each a header of named fields and data. Connections describe topics, chunks contain
messages, and a closed bag ends with an index of connections and chunks. The reader of `rosbags` is not used: it
decompresses without a limit, keeps an entry per message in memory and stops at the first damage.
"""

import os
import struct
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from enum import IntEnum
from io import BytesIO
from pathlib import Path
from typing import IO, NamedTuple

from mcap.well_known import MessageEncoding, SchemaEncoding

from ....errors import LogError
from ....system.inputs import LIMITS, open_regular, reading
from ...mcap_file.chunks import Allowance, decompress
from ...mcap_file.message import Channel, Contents, Damage, Message, Source
from ...mcap_file.records import BrokenRecord
from . import Container

MAGIC = b"#ROSBAG V2.0\n"
_Kind = IntEnum("_Kind", {"MESSAGE": 2, "BAG_HEADER": 3, "CHUNK": 5, "CHUNK_INFO": 6, "CONNECTION": 7})
_PAIR = struct.Struct("<II")  # of a time: seconds, nanoseconds; of a chunk info: connection, number of messages
_FREE_BYTES = 2**32  # total size to which small chunks may expand: under a minute of bzip2


class _Record(NamedTuple):
    """The fields of a record, and where its data lies."""

    offset: int
    fields: dict[str, bytes]
    data_at: int
    length: int

    @property
    def kind(self) -> int:
        """The operation code of the record."""
        return self.number("op", 1)

    def number(self, name: str, size: int = 4) -> int:
        """Return a field of this many bytes as a number. Raises BrokenRecord."""
        value = self.fields.get(name, b"")
        if len(value) != size:
            raise BrokenRecord(f"a record without {name}")
        return int.from_bytes(value, "little")

    def time_ns(self, name: str) -> int:
        """Return a field that is a time, nanoseconds. Raises BrokenRecord."""
        seconds, nanoseconds = _PAIR.unpack(self.number(name, 8).to_bytes(8, "little"))
        return int(seconds) * 10**9 + int(nanoseconds)


@dataclass(slots=True)
class _Index:
    """Connections and message counts by id, offset of each chunk -> ids of the connections in it, span of times."""

    connections: dict[int, Channel] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    chunks: dict[int, frozenset[int]] = field(default_factory=dict)
    spans_ns: list[int] = field(default_factory=list)
    definition_bytes: int = 0

    def add_connection(self, record: _Record, data: bytes) -> None:
        """Add the connection of a record, unless its number is known. Raises BrokenRecord."""
        number = record.number("conn")
        if number in self.connections:
            return
        topic, described = record.fields.get("topic", b""), _fields(data)
        self.definition_bytes += len(data) + len(topic) + LIMITS.object_bytes
        if self.definition_bytes > LIMITS.definitions_bytes:
            raise BrokenRecord(f"definitions of more than {LIMITS.definitions_bytes // 2**20} MiB in total")
        text, name = (value.decode("utf-8", "replace") for value in (topic, described.get("type", b"")))
        definition = described.get("message_definition", b"")
        self.connections[number] = Channel(text, MessageEncoding.ROS1, name, SchemaEncoding.ROS1, definition)


class Ros1BagSource(Source):
    """The messages of one bag, in file order. Raises LogError if it cannot be read."""

    format, profile = "ROS 1 bag", "ros1"

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._index: _Index | None = None
        self._index_problem = ""
        with self._open() as stream:
            self.size_bytes = os.fstat(stream.fileno()).st_size
            if (magic := stream.read(len(MAGIC))) != MAGIC:
                raise LogError(f"{self.path} is of another version ({magic!r}): convert it with `rosbag migrate`")
            try:
                self._index = self._read_index(stream)
            except BrokenRecord as error:
                self._index_problem = str(error)

    def _open(self) -> IO[bytes]:
        with reading(self.path):
            return open_regular(self.path, 1 << 18)

    @property
    def indexed(self) -> bool:
        return self._index is not None

    def contents(self) -> Contents | None:
        """Return the contents from the index, if the bag was closed."""
        if (index := self._index) is None:
            return None
        channels = [(channel, index.counts.get(number, 0)) for number, channel in index.connections.items()]
        return Contents(channels, min(index.spans_ns, default=0), max(index.spans_ns, default=0))

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all)."""
        if self._index_problem:
            damage.note(f"{self.path}: its index is not used: {self._index_problem}")
        reader = _MessageReader(self._index, topics)
        try:
            with self._open() as stream:
                for record in self._records(stream, damage):
                    try:
                        yield from reader.read(stream, record, self.size_bytes)
                    except BrokenRecord as error:
                        if record.data_at + record.length <= self.size_bytes:  # else the cut has been noted
                            damage.add(f"{self.path} at byte {record.offset}: a damaged record was skipped: {error}")
        except OSError as error:  # a failing disk, or a lost network share
            damage.add(f"{self.path}: reading failed after byte {damage.bytes_read}: {error.strerror}")

    def _records(self, stream: IO[bytes], damage: Damage) -> Iterator[_Record]:
        """Yield the records in order; after a damaged one, reading resumes at the next chunk in the index."""
        chunks = sorted(self._index.chunks) if self._index else []
        at = len(MAGIC)
        while at < self.size_bytes:
            damage.bytes_read = at
            try:
                record = _read_record(stream, at)
                end = record.data_at + record.length
                if end <= self.size_bytes:
                    yield record
                    at = end
                    continue
                problem = f"the record there ends {end - self.size_bytes} bytes behind the file"
                if record.kind == _Kind.CHUNK:
                    yield record  # the readable part of it
            except BrokenRecord as error:
                problem = str(error)
            number = bisect_right(chunks, at)
            if number == len(chunks):
                share = f"{at / 1e6:.2f} of {self.size_bytes / 1e6:.2f} MB could be read"
                damage.add(f"{self.path} is cut off or damaged at byte {at}: {problem}; {share}")
                return
            damage.add(f"{self.path} is damaged at byte {at}: {problem}; read on at byte {chunks[number]}")
            at = chunks[number]
        damage.bytes_read = self.size_bytes
        if self._index is None and not self._index_problem:
            damage.add(f"{self.path} has no index: the recording was not closed, its end may be missing")

    def _read_index(self, stream: IO[bytes]) -> _Index | None:
        """Return the index; None if the bag was not closed. Raises BrokenRecord if it cannot be trusted."""
        header = _read_record(stream, len(MAGIC))
        if header.kind != _Kind.BAG_HEADER:
            raise BrokenRecord("the bag header is missing")
        if header.fields.get("encryptor"):
            raise LogError(f"{self.path} is encrypted: decrypt it with `rosbag decrypt`")
        at, chunk_count = header.number("index_pos", 8), header.number("chunk_count")
        if at == 0:
            return None
        index = _Index()
        while at < self.size_bytes and len(index.connections) + len(index.chunks) < LIMITS.indexed:
            record = _read_record(stream, at)
            data = _take(stream, record.length)
            if record.kind == _Kind.CONNECTION:
                index.add_connection(record, data)
            elif record.kind == _Kind.CHUNK_INFO:
                counts = dict(_PAIR.iter_unpack(data[: len(data) // _PAIR.size * _PAIR.size]))
                index.chunks[record.number("chunk_pos", 8)] = frozenset(counts)
                for number, count in counts.items():
                    index.counts[number] = index.counts.get(number, 0) + count
                if counts:
                    index.spans_ns += (record.time_ns("start_time"), record.time_ns("end_time"))
            at = record.data_at + record.length
        if len(index.chunks) != chunk_count or not set(index.counts) <= set(index.connections):
            raise BrokenRecord("it does not list all chunks and connections")
        return index


class _MessageReader:
    """Turns records into messages of the wanted topics, and collects the connections."""

    def __init__(self, index: _Index | None, topics: frozenset[str] | None) -> None:
        self._index = replace(index, connections=dict(index.connections)) if index else _Index()
        self._topics = topics
        self._allowance = Allowance(_FREE_BYTES)

    def read(self, stream: IO[bytes], record: _Record, size: int) -> Iterator[Message]:
        """Yield the messages in a record of a stream of `size` bytes. Raises BrokenRecord."""
        kind, whole = record.kind, record.data_at + record.length <= size
        read = kind in (_Kind.CONNECTION, _Kind.MESSAGE) or (kind == _Kind.CHUNK and not self._can_skip(record))
        if not read:
            return
        stream.seek(record.data_at)
        data = stream.read(min(record.length, size - record.data_at))
        if kind == _Kind.CHUNK:
            self._allowance.begin(len(data), record.number("size"))
            content = decompress(record.fields.get("compression", b""), data, record.number("size"), whole)
            chunk, at = BytesIO(content), 0
            while at < len(content):
                inner = _read_record(chunk, at)
                self._allowance.take_record()
                if inner.kind == _Kind.CHUNK or inner.data_at + inner.length > len(content):
                    raise BrokenRecord("the records of a chunk do not add up")
                yield from self.read(chunk, inner, len(content))
                at = inner.data_at + inner.length
        elif kind == _Kind.CONNECTION:
            self._index.add_connection(record, data)
        else:
            channel = self._index.connections.get(record.number("conn"))
            if channel is None:
                raise BrokenRecord("a message of a connection that is not described")
            if self._topics is None or channel.topic in self._topics:
                yield Message(channel, record.time_ns("time"), data)

    def _can_skip(self, record: _Record) -> bool:
        """Whether the index shows that a chunk holds nothing of the wanted topics."""
        listed, topics = self._index.chunks.get(record.offset), self._topics
        if topics is None or listed is None:
            return False
        return not any(self._index.connections[number].topic in topics for number in listed)


def _read_record(stream: IO[bytes], at: int) -> _Record:
    """Return the record at a position of a file or chunk, without reading its data. Raises BrokenRecord."""
    stream.seek(at)
    header_length = int.from_bytes(_take(stream, 4), "little")
    if header_length > LIMITS.header_bytes:
        raise BrokenRecord(f"there is no record (a header of {header_length} bytes)")
    fields = _fields(_take(stream, header_length))
    if len(fields.get("op", b"")) != 1:
        raise BrokenRecord("there is no record (zeros, or damage)")
    length = int.from_bytes(_take(stream, 4), "little")
    if length > LIMITS.record_bytes:
        raise BrokenRecord(f"a record of {length / 2**20:.0f} MiB")
    return _Record(at, fields, at + 8 + header_length, length)


def _take(stream: IO[bytes], count: int) -> bytes:
    data = stream.read(count)
    if len(data) != count:
        raise BrokenRecord("the file ends within a record")
    return data


def _fields(header: bytes) -> dict[str, bytes]:
    """Return the named fields in the header of a record. Raises BrokenRecord."""
    fields: dict[str, bytes] = {}
    stream = BytesIO(header)
    while stream.tell() < len(header):
        name, equals, value = _take(stream, int.from_bytes(_take(stream, 4), "little")).partition(b"=")
        if not equals:
            raise BrokenRecord("a field of a record has no value")
        fields[name.decode("utf-8", "replace")] = value
    return fields


CONTAINER = Container(Ros1BagSource, rb"#ROSBAG", ".bag", "a ROS 1 bag")
