"""ROS 1 bags (format 2.0), read in file order: one path for indexed, unindexed, damaged and cut-off files.

A bag is a row of records, each a header of named fields and data. Connections say what a topic holds, chunks contain
messages, and an index of connections and chunks follows at the end of a bag that was closed.
"""

import bz2
import os
import struct
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, NamedTuple

import lz4.frame
from mcap.well_known import MessageEncoding, SchemaEncoding

from ..errors import LogError
from ..inputs import open_regular
from ..mcap_file.damage import Damage
from ..mcap_file.records import MAX_RECORD_BYTES
from .source import Attachment, Channel, Contents, Message

MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG_HEADER, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 5, 6, 7
_LENGTH = struct.Struct("<I")
_TIME = struct.Struct("<II")  # seconds, nanoseconds
_PAIR = struct.Struct("<II")  # of a chunk info: connection, number of messages
_MAX_HEADER_BYTES = 2**16  # the fields of one record, a few dozen bytes
_MAX_INDEXED = 2**20  # connections and chunks: a recording of a terabyte has fewer
_MAX_DEFINITIONS_BYTES = 64 * 2**20  # of all connections, which are kept while a bag is read


class _BrokenRecord(Exception):
    """A record cannot be parsed; the message says why."""


class _Record(NamedTuple):
    """The fields of a record and where its data lies; `available` is less than `length` where the file ends."""

    offset: int
    fields: dict[str, bytes]
    data_at: int
    length: int
    available: int

    @property
    def kind(self) -> int:
        """The operation code, 0 where there is none."""
        code = self.fields.get("op", b"\0")
        return code[0] if len(code) == 1 else 0


@dataclass(slots=True)
class _Index:
    """Connections by id, message counts by id, and offset of each chunk -> ids of the connections in it."""

    connections: dict[int, Channel] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    chunks: dict[int, frozenset[int]] = field(default_factory=dict)
    start_ns: int = 0
    end_ns: int = 0


class Ros1BagSource:
    """The messages of one bag, in file order. Raises LogError where it cannot be read."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        with self._open() as stream:
            self.size_bytes = os.fstat(stream.fileno()).st_size
            if (magic := stream.read(len(MAGIC))) != MAGIC:
                raise LogError(
                    f"{self.path} is a bag of another version ({magic!r}): convert it with `rosbag migrate`"
                )
            self._index: _Index | None = None
            self._index_problem = ""
            try:
                self._index = self._read_index(stream)
            except _BrokenRecord as error:
                self._index_problem = str(error)

    def _open(self) -> IO[bytes]:
        try:
            return open_regular(self.path, 1 << 18)
        except OSError as error:
            raise LogError(f"cannot read {self.path}: {error.strerror}") from None

    def contents(self) -> Contents | None:
        """From the index, where the bag was closed."""
        if self._index is None:
            return None
        channels = [(c, self._index.counts.get(i, 0)) for i, c in self._index.connections.items()]
        return Contents([*channels], self._index.start_ns, self._index.end_ns)

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all)."""
        if self._index_problem:
            damage.notes.append(f"{self.path}: its index is not used: {self._index_problem}")
        reader = _MessageReader(self._index, topics)
        try:
            with self._open() as stream:
                for record in self._records(stream, damage):
                    whole = record.available == record.length
                    if record.kind not in (_CHUNK, _CONNECTION, _MESSAGE) or not reader.wants(record):
                        continue
                    try:
                        stream.seek(record.data_at)
                        data = stream.read(record.available)
                        yield from reader.read(record, data, whole)
                    except _BrokenRecord as error:
                        if whole:  # else the cut has been noted
                            damage.add(f"{self.path} at byte {record.offset}: skipped: {error}")
        except OSError as error:  # a failing disk, a network share that went away
            damage.add(f"{self.path}: reading failed after byte {damage.bytes_read}: {error.strerror}")

    def _records(self, stream: IO[bytes], damage: Damage) -> Iterator[_Record]:
        """Yield the records in order; where one is damaged, reading resumes at the next chunk that the index lists."""
        chunks = sorted(self._index.chunks) if self._index else []
        at = len(MAGIC)
        while at < self.size_bytes:
            damage.bytes_read = at
            problem = ""
            try:
                record = _read_record(stream, at, self.size_bytes)
                if record.available == record.length:
                    yield record
                    at = record.data_at + record.length
                    continue
                problem = f"the record there has {record.length} bytes, only {record.available} follow"
                if record.kind == _CHUNK and record.available <= MAX_RECORD_BYTES:
                    yield record  # as far as it goes
            except _BrokenRecord as error:
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
        """The index; None where the bag was not closed. Raises _BrokenRecord where it cannot be trusted."""
        header = _read_record(stream, len(MAGIC), self.size_bytes)
        if header.kind != _BAG_HEADER:
            raise _BrokenRecord("the bag header is missing")
        if header.fields.get("encryptor"):
            raise LogError(f"{self.path} is encrypted: decrypt it with `rosbag decrypt`")
        at, chunk_count = _number(header, "index_pos", 8), _number(header, "chunk_count", 4)
        if at == 0:
            return None
        index = _Index()
        spans = []
        while at < self.size_bytes and len(index.connections) + len(index.chunks) < _MAX_INDEXED:
            record = _read_record(stream, at, self.size_bytes)
            if record.available < record.length:
                raise _BrokenRecord("it is cut off")
            stream.seek(record.data_at)
            data = stream.read(record.length)
            if record.kind == _CONNECTION:
                index.connections[_number(record, "conn", 4)] = _connection(record, data)
            elif record.kind == _CHUNK_INFO:
                counts = dict(_PAIR.iter_unpack(data[: len(data) // _PAIR.size * _PAIR.size]))
                index.chunks[_number(record, "chunk_pos", 8)] = frozenset(counts)
                for number, count in counts.items():
                    index.counts[number] = index.counts.get(number, 0) + count
                if counts:
                    spans.append((_time_ns(record, "start_time"), _time_ns(record, "end_time")))
            at = record.data_at + record.length
        if len(index.chunks) != chunk_count or not set(index.counts) <= set(index.connections):
            raise _BrokenRecord("it does not list all chunks and connections")
        if spans:
            index.start_ns, index.end_ns = min(s for s, _ in spans), max(e for _, e in spans)
        return index

    def attachments(self, damage: Damage) -> Iterator[Attachment]:
        """Bags have no attachments."""
        return iter(())

    def description(self) -> dict[str, Any]:
        """See `Source`."""
        return {"format": "ROS 1 bag", "profile": "ros1", "library": None, "indexed": self._index is not None}

    def drop_unverified_index(self) -> bool:
        """See `Source`; the index of a bag is compared with its chunks when it is read."""
        return False


class _MessageReader:
    """Turns records into messages of the wanted topics, and collects connections on the way."""

    def __init__(self, index: _Index | None, topics: frozenset[str] | None) -> None:
        self._index, self._topics = index, topics
        self._connections = dict(index.connections) if index else {}
        self._definition_bytes = 0

    def wants(self, record: _Record) -> bool:
        """Whether a record can hold anything of the wanted topics."""
        if self._topics is None or self._index is None or record.kind != _CHUNK:
            return True
        listed = self._index.chunks.get(record.offset)
        return listed is None or any(self._index.connections[i].topic in self._topics for i in listed)

    def read(self, record: _Record, data: bytes, whole: bool) -> Iterator[Message]:
        """Yield the messages in a record. Raises _BrokenRecord."""
        if record.kind == _CHUNK:
            content = _decompress(record, data, whole)
            at = 0
            while at < len(content):
                inner = _parse_record(content, at)
                yield from self.read(inner, content[inner.data_at : inner.data_at + inner.length], True)
                at = inner.data_at + inner.length
        elif record.kind == _CONNECTION:
            number = _number(record, "conn", 4)
            if number not in self._connections:
                self._definition_bytes += len(data)
                if self._definition_bytes > _MAX_DEFINITIONS_BYTES:
                    raise _BrokenRecord(f"definitions of more than {_MAX_DEFINITIONS_BYTES // 2**20} MiB in total")
                self._connections[number] = _connection(record, data)
        elif record.kind == _MESSAGE:
            channel = self._connections.get(_number(record, "conn", 4))
            if channel is None:
                raise _BrokenRecord("a message of a connection that is not described")
            if self._topics is None or channel.topic in self._topics:
                yield Message(channel, _time_ns(record, "time"), data)


def _read_record(stream: IO[bytes], at: int, size: int) -> _Record:
    """The record at a position of the file, its data unread. Raises _BrokenRecord."""
    stream.seek(at)
    (header_length,) = _LENGTH.unpack(_exactly(stream.read(_LENGTH.size), _LENGTH.size))
    if header_length > _MAX_HEADER_BYTES:
        raise _BrokenRecord(f"there is no record (a header of {header_length} bytes)")
    fields = _fields(_exactly(stream.read(header_length), header_length))
    (length,) = _LENGTH.unpack(_exactly(stream.read(_LENGTH.size), _LENGTH.size))
    data_at = at + 2 * _LENGTH.size + header_length
    record = _Record(at, fields, data_at, length, min(length, size - data_at))
    if record.kind == 0:
        raise _BrokenRecord("there is no record (zeros, or damage)")
    if length > MAX_RECORD_BYTES:
        raise _BrokenRecord(f"a record of {length / 2**20:.0f} MiB")
    return record


def _parse_record(data: bytes, at: int) -> _Record:
    """The record at a position of a chunk, whole. Raises _BrokenRecord."""
    (header_length,) = _LENGTH.unpack(_exactly(data[at : at + _LENGTH.size], _LENGTH.size))
    start = at + _LENGTH.size
    fields = _fields(_exactly(data[start : start + header_length], header_length))
    start += header_length
    (length,) = _LENGTH.unpack(_exactly(data[start : start + _LENGTH.size], _LENGTH.size))
    start += _LENGTH.size
    if length > len(data) - start:
        raise _BrokenRecord("the last record of a chunk is cut off")
    return _Record(at, fields, start, length, length)


def _exactly(data: bytes, length: int) -> bytes:
    if len(data) != length:
        raise _BrokenRecord("the file ends within a record")
    return data


def _fields(header: bytes) -> dict[str, bytes]:
    """The named fields of a record's header. Raises _BrokenRecord."""
    fields: dict[str, bytes] = {}
    at = 0
    while at < len(header):
        (length,) = _LENGTH.unpack(_exactly(header[at : at + _LENGTH.size], _LENGTH.size))
        at += _LENGTH.size
        name, equals, value = _exactly(header[at : at + length], length).partition(b"=")
        if not equals:
            raise _BrokenRecord("a field of a record has no value")
        fields[name.decode("utf-8", "replace")] = value
        at += length
    return fields


def _number(record: _Record, name: str, size: int) -> int:
    value = record.fields.get(name, b"")
    if len(value) != size:
        raise _BrokenRecord(f"a record without {name}")
    return int.from_bytes(value, "little")


def _time_ns(record: _Record, name: str) -> int:
    value = record.fields.get(name, b"")
    if len(value) != _TIME.size:
        raise _BrokenRecord(f"a record without {name}")
    seconds, nanoseconds = _TIME.unpack(value)
    return int(seconds) * 10**9 + int(nanoseconds)


def _connection(record: _Record, data: bytes) -> Channel:
    described = _fields(data)
    topic = record.fields.get("topic", b"").decode("utf-8", "replace")
    name = described.get("type", b"").decode("utf-8", "replace")
    return Channel(topic, MessageEncoding.ROS1, name, SchemaEncoding.ROS1, described.get("message_definition", b""))


def _decompress(record: _Record, data: bytes, whole: bool) -> bytes:
    """The records in a chunk; where it is cut off (not `whole`), those before the cut. Raises _BrokenRecord."""
    compression, size = record.fields.get("compression", b""), _number(record, "size", 4)
    if size > MAX_RECORD_BYTES:
        raise _BrokenRecord(f"a chunk that declares {size / 2**20:.0f} MiB")
    try:
        if compression == b"none":
            content = data
        elif compression == b"bz2":
            content = bz2.BZ2Decompressor().decompress(data, max_length=size)
        elif compression == b"lz4":
            content = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size)
        else:
            raise _BrokenRecord(f"a chunk in compression {compression!r}, which is not supported")
    except (OSError, EOFError, RuntimeError, ValueError, MemoryError) as error:
        raise _BrokenRecord(f"a damaged chunk of {len(data)} bytes: {error}") from None
    if whole and len(content) != size:
        raise _BrokenRecord(f"a damaged chunk: it decompresses to {len(content)} bytes but declares {size}")
    return content
