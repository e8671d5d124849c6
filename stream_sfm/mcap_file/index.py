"""The summary section at the end of an MCAP file, used as far as it can be verified."""

import os
import struct
import zlib
from dataclasses import dataclass
from typing import IO

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Schema, Statistics

from .definitions import Definitions
from .records import MAGIC, MAX_RECORD_BYTES, RECORD_HEAD, BrokenRecord, parse_record, split_records

_FOOTER_BYTES = 20  # fixed by the specification
_DATA_END = RECORD_HEAD.pack(Opcode.DATA_END, 4)
_CHUNK_HEAD = struct.Struct("<QQQ")  # first and last log time, uncompressed size
_MAX_MOVED_BYTES = 16 * 2**20  # a larger summary is not looked for
_MAX_DATA_ENDS = 8  # that are tried
_MAX_CHUNK_COST = 2**20  # chunks and distinct channel sets kept; a recording of a terabyte has fewer


@dataclass(slots=True)
class Index:
    """The content of the summary: schemas and channels, message counts by channel id, the span of log times.

    `counts` is empty where the summary does not tell. `chunk_channels`: offset of each chunk, ascending -> ids of the
    channels with messages in it (None: unknown). Only chunks that lie where the index says are listed, and none where
    skipping one would be unsafe: the summary has no checksum, or lists more chunks than any recording has. `problem`
    says what does not fit the file, and is empty where all does.
    """

    definitions: Definitions
    counts: dict[int, int]
    start_ns: int
    end_ns: int
    chunk_channels: dict[int, frozenset[int] | None]
    attachment_count: int
    checksummed: bool
    problem: str = ""

    @property
    def schemas(self) -> dict[int, Schema]:
        """Schemas by id."""
        return self.definitions.schemas

    @property
    def channels(self) -> dict[int, Channel]:
        """Channels by id."""
        return self.definitions.channels


def read_index(stream: IO[bytes]) -> Index | None:
    """Read the summary; None where the file has none. Raises BrokenRecord where it has one that cannot be trusted."""
    size = os.fstat(stream.fileno()).st_size
    tail = RECORD_HEAD.size + _FOOTER_BYTES + len(MAGIC)
    if size < 2 * len(MAGIC) + tail:
        return None
    stream.seek(size - tail)
    end = stream.read(tail)
    if (
        len(end) < tail
        or end[-len(MAGIC) :] != MAGIC
        or RECORD_HEAD.unpack_from(end) != (Opcode.FOOTER, _FOOTER_BYTES)
    ):
        return None
    footer = parse_record(Footer.read, end[RECORD_HEAD.size : -len(MAGIC)])
    if footer.summary_start == 0:
        return None
    summary_end, shift = size - tail, 0
    summary = _summary_at(stream, footer.summary_start, summary_end)
    # The checksum covers the summary and the footer up to the checksum itself.
    closing = end[: RECORD_HEAD.size + _FOOTER_BYTES - 4]
    if summary is None or footer.summary_crc not in (0, zlib.crc32(closing, zlib.crc32(summary))):
        moved = _moved_summary(stream, summary_end, closing, footer.summary_crc)
        if moved is None:
            outside = "the footer points outside the file"
            raise BrokenRecord(outside if summary is None else "its checksum does not match its content")
        summary, shift = moved, summary_end - len(moved) - footer.summary_start
    return _parse_index(summary, _File(stream, size, shift), footer.summary_crc != 0)


def _summary_at(stream: IO[bytes], start: int, end: int) -> bytes | None:
    if start < len(MAGIC) or not 0 < end - start <= MAX_RECORD_BYTES:
        return None
    stream.seek(start)
    return stream.read(end - start)


def _moved_summary(stream: IO[bytes], end: int, closing: bytes, crc: int) -> bytes | None:
    """The summary that ends at `end` and has this checksum, where bytes before it were lost or added."""
    if crc == 0:
        return None
    start = max(len(MAGIC), end - _MAX_MOVED_BYTES)
    stream.seek(start)
    data = stream.read(end - start)
    at = len(data)
    for _ in range(_MAX_DATA_ENDS):
        if (at := data.rfind(_DATA_END, 0, at)) < 0:
            return None
        summary = data[at + len(_DATA_END) + 4 :]
        if zlib.crc32(closing, zlib.crc32(summary)) == crc:
            return summary
    return None


def _parse_index(summary: bytes, file: "_File", checksummed: bool) -> Index | None:
    definitions = Definitions()
    statistics: Statistics | None = None
    chunks = _ChunkList(file)
    for opcode, body in split_records(memoryview(summary)):
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            definitions.add(opcode, body)
        elif opcode == Opcode.STATISTICS:
            statistics = parse_record(Statistics.read, body)
        elif opcode == Opcode.CHUNK_INDEX:
            chunks.add(parse_record(ChunkIndex.read, body))
    schemas, channels = definitions.schemas, definitions.channels
    if not channels or statistics is None:
        return None  # allowed by the specification, but of no use
    counts = dict(statistics.channel_message_counts)
    if any(c.schema_id and c.schema_id not in schemas for c in channels.values()):
        raise BrokenRecord("a channel's schema is missing")
    if statistics.channel_count != len(channels) or not set(counts) <= set(channels):
        raise BrokenRecord("its statistics are of other channels")
    found = chunks.found(set(channels)) if checksummed else {}
    problem = f"it lies {abs(file.shift)} bytes from where it was written" if file.shift else ""
    if checksummed and not chunks.too_many and len(found) < chunks.listed:
        missing = f"{chunks.listed - len(found)} of {chunks.listed} chunks are not where it lists them"
        problem = f"{problem}, {missing}" if problem else missing
    return Index(
        definitions,
        counts,
        statistics.message_start_time,
        statistics.message_end_time,
        found,
        statistics.attachment_count,
        checksummed,
        problem,
    )


@dataclass(frozen=True, slots=True)
class _File:
    """The file with the summary, which lies `shift` bytes behind where the footer says."""

    stream: IO[bytes]
    size: int
    shift: int

    def has_chunk(self, offset: int, chunk: ChunkIndex) -> bool:
        """Whether the chunk of an index entry begins there."""
        length = chunk.chunk_length - RECORD_HEAD.size
        if length < _CHUNK_HEAD.size or not 0 < offset <= self.size - chunk.chunk_length:
            return False
        self.stream.seek(offset)
        start = self.stream.read(RECORD_HEAD.size + _CHUNK_HEAD.size)
        times = chunk.message_start_time, chunk.message_end_time
        return start == RECORD_HEAD.pack(Opcode.CHUNK, length) + _CHUNK_HEAD.pack(*times, chunk.uncompressed_size)


class _ChunkList:
    """The chunks that a summary lists, as far as the file has them there, or as far behind as the summary is.

    `ids_at`: offset of a chunk -> ids of its channels; equal sets of ids are stored once.
    """

    def __init__(self, file: _File) -> None:
        self.listed = 0
        self.ids_at: dict[int, frozenset[int]] = {}
        self._file = file
        self._distinct: dict[frozenset[int], frozenset[int]] = {}
        self._cost = 0  # chunks, and members of distinct sets

    @property
    def too_many(self) -> bool:
        """Whether the limit was exceeded; no chunk is kept then."""
        return self._cost > _MAX_CHUNK_COST

    def add(self, chunk: ChunkIndex) -> None:
        """Add one chunk of the summary."""
        ids = frozenset(chunk.message_index_offsets)
        self.listed += 1
        self._cost += 1 + (0 if ids in self._distinct else len(ids))
        if self.too_many:
            self.ids_at.clear()
            self._distinct.clear()
            return
        ids = self._distinct.setdefault(ids, ids)
        for offset in {chunk.chunk_start_offset, chunk.chunk_start_offset + self._file.shift}:
            if self._file.has_chunk(offset, chunk):
                self.ids_at[offset] = ids

    def found(self, channels: set[int]) -> dict[int, frozenset[int] | None]:
        """Offset -> ids of channels (None: not known), ascending."""
        return {at: ids if ids and ids <= channels else None for at, ids in sorted(self.ids_at.items())}
