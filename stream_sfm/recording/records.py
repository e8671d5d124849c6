"""MCAP records in the order of the file: one path for whole, unindexed, damaged and cut-off files.

The framing is read here and only the bodies are handed to the `mcap` library, because its readers believe the
lengths that a damaged file claims, let five kinds of exception escape, and inflate a chunk before anybody has
looked at its size. What is found wrong is collected in `Damage`; messages before and after it are delivered.
"""

import io
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, ChunkIndex, Footer, Header, Schema, Statistics

from ..errors import LogError

MAGIC = b"\x89MCAP0\r\n"
MAX_RECORD_BYTES = 512 * 2**20  # a record or an inflated chunk beyond this is damage, or hostile
_FRAME = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK = struct.Struct("<QQQI")


class LogMessage(NamedTuple):
    """One message as stored: `channel` and `schema` (None: schemaless) describe the bytes in `data`."""

    channel: Channel
    schema: Schema | None
    log_time_ns: int
    data: bytes


@dataclass(slots=True)
class Damage:
    """What one reading of a log met: `notes` for people; `complete` is false once anything was lost."""

    complete: bool = True
    bytes_read: int = 0
    notes: list[str] = field(default_factory=list)

    def add(self, note: str) -> None:
        """Something was lost."""
        self.complete = False
        if note not in self.notes:
            self.notes.append(note)


class _Broken(Exception):
    """The record cannot be parsed; the message says why."""


@dataclass(slots=True)
class Index:
    """What the summary section says. `counts`: messages a channel id; `chunk_channels`: chunk offset -> ids."""

    schemas: dict[int, Schema]
    channels: dict[int, Channel]
    counts: dict[int, int] | None
    start_ns: int
    end_ns: int
    chunk_channels: dict[int, frozenset[int]]
    attachment_count: int


class LogFile:
    """One MCAP file, opened anew for every reading, so that readings do not disturb each other.

    Raises LogError where the path cannot be opened, is empty, or is not MCAP.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if self.path.is_dir():
            raise LogError(f"{self.path} is a folder: give the .mcap file in it")
        with self._open() as stream:
            self.size = os.fstat(stream.fileno()).st_size
            start = stream.read(len(MAGIC))
            if self.size == 0:
                raise LogError(f"{self.path} is empty (0 bytes): the recording was never written")
            if start != MAGIC:
                kind = _other_format(start)
                raise LogError(f"{self.path} is not an MCAP file{kind}; its first bytes are {start!r}")
            self.index = self._read_index(stream)

    def _open(self) -> IO[bytes]:
        try:
            return open(self.path, "rb", buffering=1 << 18)
        except OSError as error:
            raise LogError(f"cannot read {self.path}: {error.strerror}") from None

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[LogMessage]:
        """All messages of `topics` (None: all) in file order. What cannot be read is noted in `damage`.

        With `topics` given, chunks in which the index lists none of them are passed over unopened.
        """
        try:
            yield from self._messages(damage, topics)
        except OSError as error:  # a failing disk, a share that went away
            damage.add(f"{self.path}: reading failed after byte {damage.bytes_read}: {error.strerror}")

    def _messages(self, damage: Damage, topics: frozenset[str] | None) -> Iterator[LogMessage]:
        # The index's copies serve where the chunk that first described a channel is damaged.
        channels: dict[int, Channel] = dict(self.index.channels) if self.index else {}
        schemas: dict[int, Schema] = dict(self.index.schemas) if self.index else {}
        wanted_ids: frozenset[int] | None = None
        if topics is not None and self.index is not None:
            wanted_ids = frozenset(i for i, c in self.index.channels.items() if c.topic in topics)

        def parse(opcode: int, body: bytes | memoryview, where: str) -> LogMessage | None:
            if opcode == Opcode.MESSAGE:
                if len(body) < _MESSAGE.size:
                    raise _Broken("a message shorter than its header")
                channel_id, _, log_time_ns, _ = _MESSAGE.unpack_from(body)
                channel = channels.get(channel_id)
                if channel is None:
                    damage.add(
                        f"{where}: messages of channel {channel_id}, which is not described, are passed over"
                    )
                elif topics is None or channel.topic in topics:
                    # bytes, because a view would keep its whole chunk in memory
                    data = bytes(body[_MESSAGE.size :])
                    return LogMessage(channel, schemas.get(channel.schema_id), log_time_ns, data)
            elif opcode == Opcode.CHANNEL:
                channel = _parse(Channel.read, body)
                channels[channel.id] = channel
            elif opcode == Opcode.SCHEMA:
                schema = _parse(Schema.read, body)
                schemas[schema.id] = schema
            return None

        with self._open() as stream:
            stream.seek(len(MAGIC))
            damage.bytes_read = len(MAGIC)
            while (framed := self._next(stream, damage)) is not None:
                offset, opcode, length, available = framed
                where = f"{self.path} at byte {offset}"
                if opcode in (Opcode.FOOTER, Opcode.DATA_END):
                    break
                if opcode == Opcode.CHUNK:
                    listed = (
                        self.index.chunk_channels.get(offset) if self.index and wanted_ids is not None else None
                    )
                    unwanted = listed is not None and wanted_ids is not None and listed.isdisjoint(wanted_ids)
                    if unwanted and available == length:
                        stream.seek(length, os.SEEK_CUR)
                        damage.bytes_read = stream.tell()
                        continue
                    body = stream.read(available)
                    for inner_opcode, inner in _chunk_records(body, length, where, damage):
                        try:
                            message = parse(inner_opcode, inner, where)
                        except _Broken as error:
                            damage.add(f"{where}: the rest of the chunk is lost: {error}")
                            break
                        if message is not None:
                            yield message
                elif available < length:
                    pass  # cut off inside this record: `_next` has noted it
                elif opcode in (Opcode.MESSAGE, Opcode.CHANNEL, Opcode.SCHEMA):
                    try:
                        message = parse(opcode, stream.read(length), where)
                    except _Broken as error:
                        damage.add(f"{where}: a damaged record was passed over: {error}")
                        message = None
                    if message is not None:
                        yield message
                else:
                    stream.seek(length, os.SEEK_CUR)
                if available < length:
                    damage.bytes_read = offset
                    break
                damage.bytes_read = stream.tell()
            else:
                return
            if available == length:
                damage.bytes_read = self.size  # what follows is the summary

    def _next(self, stream: IO[bytes], damage: Damage) -> tuple[int, int, int, int] | None:
        """Offset, opcode, length and length in the file of the next record; None, with a note, at a cut."""
        offset = stream.tell()
        frame = stream.read(_FRAME.size)
        left = self.size - offset - len(frame)
        read = f"{offset / 1e6:.2f} of {self.size / 1e6:.2f} MB ({100 * offset / self.size:.0f} %) could be read"
        if len(frame) < _FRAME.size:
            damage.add(f"{self.path} is cut off at byte {offset}: the recording was not closed; {read}")
            return None
        opcode, length = _FRAME.unpack(frame)
        if opcode == 0:
            damage.add(f"{self.path} holds no record at byte {offset} (zeros, or damage); {read}")
            return None
        if length > left:
            damage.add(
                f"{self.path} is cut off or damaged at byte {offset}: the record there has {length} bytes, "
                f"only {left} follow; {read}"
            )
            # A chunk can be read as far as it goes; anything else claiming so much is of no use.
            return offset, opcode, length, left
        if length > MAX_RECORD_BYTES and opcode in (Opcode.MESSAGE, Opcode.CHUNK, Opcode.CHANNEL, Opcode.SCHEMA):
            damage.add(f"{self.path} at byte {offset}: a record of {length / 2**20:.0f} MiB is passed over")
            stream.seek(length, os.SEEK_CUR)
            return self._next(stream, damage)
        return offset, opcode, length, length

    def attachments(self, damage: Damage, max_bytes: int = 2**20) -> Iterator[Attachment]:
        """The attachments of at most `max_bytes`, in file order."""
        if self.index is not None and self.index.attachment_count == 0:
            return
        with self._open() as stream:
            stream.seek(len(MAGIC))
            while (framed := self._next(stream, damage)) is not None:
                _, opcode, length, available = framed
                if opcode in (Opcode.FOOTER, Opcode.DATA_END) or available < length:
                    return
                if opcode == Opcode.ATTACHMENT and length <= max_bytes:
                    try:
                        yield _parse(Attachment.read, stream.read(length))
                    except _Broken as error:
                        damage.add(f"{self.path}: a damaged attachment was passed over: {error}")
                else:
                    stream.seek(length, os.SEEK_CUR)

    def _read_index(self, stream: IO[bytes]) -> Index | None:
        """The summary, or None where it is missing, damaged, or at odds with the file: then nobody trusts it."""
        tail = _FRAME.size + 20 + len(MAGIC)
        if self.size < 2 * len(MAGIC) + tail:
            return None
        stream.seek(self.size - tail)
        end = stream.read(tail)
        if end[-len(MAGIC) :] != MAGIC or _FRAME.unpack_from(end) != (Opcode.FOOTER, 20):
            return None
        try:
            footer = _parse(Footer.read, end[_FRAME.size : -len(MAGIC)])
            length = self.size - tail - footer.summary_start
            if footer.summary_start < len(MAGIC) or not 0 < length <= MAX_RECORD_BYTES:
                return None
            stream.seek(footer.summary_start)
            summary = stream.read(length)
            # The checksum covers the summary and the footer up to the checksum itself.
            crc = zlib.crc32(end[: _FRAME.size + 16], zlib.crc32(summary))
            if footer.summary_crc not in (0, crc):
                return None
            return self._parse_index(summary, stream)
        except _Broken:
            return None

    def _parse_index(self, summary: bytes, stream: IO[bytes]) -> Index | None:
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        statistics: Statistics | None = None
        chunks: list[ChunkIndex] = []
        for opcode, body in _split(memoryview(summary)):
            if opcode == Opcode.SCHEMA:
                schema = _parse(Schema.read, body)
                schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = _parse(Channel.read, body)
                channels[channel.id] = channel
            elif opcode == Opcode.STATISTICS:
                statistics = _parse(Statistics.read, body)
            elif opcode == Opcode.CHUNK_INDEX:
                chunks.append(_parse(ChunkIndex.read, body))
        counts = dict(statistics.channel_message_counts) if statistics else None
        described = all(c.schema_id == 0 or c.schema_id in schemas for c in channels.values())
        if not channels or not described or statistics is None:
            return None
        if statistics.channel_count != len(channels) or (statistics.chunk_count > 0 and not chunks):
            return None
        if counts and not set(counts) <= set(channels):
            return None
        for chunk in chunks:
            stream.seek(min(chunk.chunk_start_offset, self.size))
            if stream.read(1) != bytes([Opcode.CHUNK]):
                return None
        listed = {
            c.chunk_start_offset: frozenset(c.message_index_offsets) for c in chunks if c.message_index_offsets
        }
        span_ns = statistics.message_start_time, statistics.message_end_time
        return Index(schemas, channels, counts, *span_ns, listed, statistics.attachment_count)

    def header(self) -> Header | None:
        """The header record, None where it is damaged."""
        with self._open() as stream:
            stream.seek(len(MAGIC))
            framed = self._next(stream, Damage())
            if framed is None or framed[1] != Opcode.HEADER or framed[2] > 2**16 or framed[3] < framed[2]:
                return None
            try:
                return _parse(Header.read, stream.read(framed[2]))
            except _Broken:
                return None


def _other_format(start: bytes) -> str:
    if start.startswith(b"#ROSBAG"):
        return " but a ROS 1 bag: convert it with `mcap convert in.bag out.mcap`"
    if start.startswith(b"SQLite"):
        return " but a ROS 2 SQLite bag: convert it with `ros2 bag convert` to storage id mcap"
    if start.startswith(b"RRF"):
        return " but a Rerun recording"
    if start.startswith(MAGIC[:5]):
        return " of version 0"
    return ""


def _parse(reader: Callable[..., Any], body: bytes | memoryview) -> Any:
    """One record by the mcap library, any failure as `_Broken`."""
    try:
        return reader(ReadDataStream(io.BytesIO(body)))
    except Exception as error:  # struct.error, EndOfFile, UnicodeDecodeError, KeyError: the body is damaged
        raise _Broken(f"{type(error).__name__} {error}".strip()) from None


def _split(body: memoryview) -> Iterator[tuple[int, memoryview]]:
    """The records in the inflated bytes of a chunk; raises `_Broken` where they do not add up."""
    position = 0
    while position < len(body):
        if position + _FRAME.size > len(body):
            raise _Broken("the last record is cut off")
        opcode, length = _FRAME.unpack_from(body, position)
        position += _FRAME.size
        if length > len(body) - position:
            raise _Broken(f"a record of {length} bytes where {len(body) - position} are left")
        yield opcode, body[position : position + length]
        position += length


def _chunk_records(
    body: bytes, length: int, where: str, damage: Damage
) -> Iterator[tuple[int, bytes | memoryview]]:
    """The records of a chunk. Of a chunk that is cut off (body shorter than `length`): those before the cut."""
    whole = len(body) == length
    try:
        inflated, crc = _inflate(body, whole)
        if crc and whole and zlib.crc32(inflated) != crc:
            raise _Broken("its checksum does not fit its content")
    except _Broken as error:
        if whole:
            damage.add(f"{where}: a damaged chunk of {length} bytes was passed over: {error}")
        return
    try:
        yield from _split(memoryview(inflated))
    except _Broken as error:
        if whole:
            damage.add(f"{where}: the rest of the chunk is lost: {error}")


def _inflate(body: bytes, whole: bool) -> tuple[bytes, int]:
    """Content and checksum of a chunk's body, never more bytes than it declares."""
    if len(body) < _CHUNK.size + 4:
        raise _Broken("its header is cut off")
    _, _, size, crc = _CHUNK.unpack_from(body)
    if size > MAX_RECORD_BYTES:
        raise _Broken(f"it claims to inflate to {size / 2**20:.0f} MiB, over {MAX_RECORD_BYTES / 2**20:.0f}")
    (name_length,) = struct.unpack_from("<I", body, _CHUNK.size)
    start = _CHUNK.size + 4 + name_length + 8
    if start > len(body):
        raise _Broken("its header is cut off")
    compression = bytes(body[_CHUNK.size + 4 : start - 8])
    (data_length,) = struct.unpack_from("<Q", body, start - 8)
    data = memoryview(body)[start:]
    if whole and data_length > len(data):
        raise _Broken("its lengths do not add up")
    data = data[:data_length]
    try:
        if compression == b"zstd":
            with zstandard.ZstdDecompressor().stream_reader(data) as reader:
                inflated = _read_to(reader, size, whole)
        elif compression == b"lz4":
            inflated = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size)
        elif compression == b"":
            inflated = bytes(data)
        else:
            raise _Broken(f"compression {compression!r} is not known; zstd, lz4 and none are")
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise _Broken(f"it cannot be inflated: {error}") from None
    if whole and len(inflated) != size:
        raise _Broken(f"it inflates to {len(inflated)} bytes and claims {size}")
    return inflated, crc


def _read_to(reader: Any, size: int, whole: bool) -> bytes:
    """Up to `size` bytes; of a cut-off stream what comes before the cut."""
    if whole:
        return reader.read(size) if size else b""
    parts: list[bytes] = []
    try:
        while size > 0 and (part := reader.read(min(size, 1 << 17))):
            parts.append(part)
            size -= len(part)
    except zstandard.ZstdError:
        pass  # the cut
    return b"".join(parts)
