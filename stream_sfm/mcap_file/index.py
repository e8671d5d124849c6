"""The summary section at the end of an MCAP file, used as far as it can be verified."""

import os
import zlib
from dataclasses import dataclass
from typing import IO

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Schema, Statistics

from .definitions import Definitions
from .records import MAGIC, MAX_RECORD_BYTES, RECORD_HEAD, BrokenRecord, parse_record, split_records

_FOOTER_BYTES = 20  # fixed by the specification
_MAX_CHUNK_COST = 2**20  # chunks and distinct channel sets kept; a recording of a terabyte has fewer


@dataclass(slots=True)
class Index:
    """The content of the summary: schemas and channels, message counts by channel id, the span of log times.

    `counts` is empty where the summary does not tell. `chunk_channels`: offset of each chunk, ascending -> ids of the
    channels with messages in it (None: unknown). It is empty where skipping a chunk or jumping to one would be
    unsafe: the summary has no checksum, does not match the file, or lists more chunks than any recording has.
    """

    definitions: Definitions
    counts: dict[int, int]
    start_ns: int
    end_ns: int
    chunk_channels: dict[int, frozenset[int] | None]
    attachment_count: int
    checksummed: bool

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
    if end[-len(MAGIC) :] != MAGIC or RECORD_HEAD.unpack_from(end) != (Opcode.FOOTER, _FOOTER_BYTES):
        return None
    footer = parse_record(Footer.read, end[RECORD_HEAD.size : -len(MAGIC)])
    if footer.summary_start == 0:
        return None
    length = size - tail - footer.summary_start
    if footer.summary_start < len(MAGIC) or not 0 < length <= MAX_RECORD_BYTES:
        raise BrokenRecord("the footer points outside the file")
    stream.seek(footer.summary_start)
    summary = stream.read(length)
    # The checksum covers the summary and the footer up to the checksum itself.
    crc = zlib.crc32(end[: RECORD_HEAD.size + _FOOTER_BYTES - 4], zlib.crc32(summary))
    if footer.summary_crc not in (0, crc):
        raise BrokenRecord("its checksum does not match its content")
    return _parse_index(summary, stream, size, footer.summary_crc != 0)


def _parse_index(summary: bytes, stream: IO[bytes], size: int, checksummed: bool) -> Index | None:
    definitions = Definitions()
    statistics: Statistics | None = None
    chunks = _ChunkList()
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
    trusted = checksummed and not chunks.too_many and statistics.chunk_count == len(chunks.ids_at)
    trusted = trusted and all(ids <= set(channels) for ids in chunks.distinct)
    listed: dict[int, frozenset[int] | None] = {}
    for offset in sorted(chunks.ids_at) if trusted else ():
        stream.seek(min(offset, size))
        trusted &= stream.read(1) == bytes([Opcode.CHUNK])
        listed[offset] = chunks.ids_at[offset] or None
    span_ns = statistics.message_start_time, statistics.message_end_time
    return Index(definitions, counts, *span_ns, listed if trusted else {}, statistics.attachment_count, checksummed)


class _ChunkList:
    """`ids_at`: offset of a chunk -> ids of its channels; equal sets of ids (`distinct`) are stored once."""

    def __init__(self) -> None:
        self.ids_at: dict[int, frozenset[int]] = {}
        self.distinct: dict[frozenset[int], frozenset[int]] = {}
        self._cost = 0  # chunks, and members of distinct sets

    @property
    def too_many(self) -> bool:
        """Whether the limit was exceeded; no chunk is kept then."""
        return self._cost > _MAX_CHUNK_COST

    def add(self, chunk: ChunkIndex) -> None:
        """Add one chunk of the summary."""
        ids = frozenset(chunk.message_index_offsets)
        self._cost += 1 + (0 if ids in self.distinct else len(ids))
        if self.too_many:
            self.ids_at.clear()
            self.distinct.clear()
        else:
            self.ids_at[chunk.chunk_start_offset] = self.distinct.setdefault(ids, ids)
