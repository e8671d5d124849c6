"""The summary section at the end of an MCAP file, believed only as far as it can be checked."""

import os
import zlib
from dataclasses import dataclass
from typing import IO

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Schema, Statistics

from .definitions import Definitions
from .records import FRAME, MAGIC, MAX_RECORD_BYTES, BrokenRecord, parse, split

_MAX_LISTED = 2**20  # chunks: a recording of a terabyte has fewer


@dataclass(slots=True)
class Index:
    """What the summary says. `definitions`: the schemas and channels; `counts`: messages a channel id, empty where
    they are not told.

    `chunk_channels`: offset of each chunk, ascending -> ids of the channels with messages in it (None: not told).
    Whoever passes over a chunk or jumps to one has to be sure: it is empty where the summary carries no checksum,
    is not of this file as it stands, or lists more than any recording has.
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
        """By id."""
        return self.definitions.schemas

    @property
    def channels(self) -> dict[int, Channel]:
        """By id."""
        return self.definitions.channels


def read_index(stream: IO[bytes]) -> Index | None:
    """The summary; None where the file has none. Raises BrokenRecord where it has one that cannot be believed."""
    size = os.fstat(stream.fileno()).st_size
    tail = FRAME.size + 20 + len(MAGIC)
    if size < 2 * len(MAGIC) + tail:
        return None
    stream.seek(size - tail)
    end = stream.read(tail)
    if end[-len(MAGIC) :] != MAGIC or FRAME.unpack_from(end) != (Opcode.FOOTER, 20):
        return None
    footer = parse(Footer.read, end[FRAME.size : -len(MAGIC)])
    if footer.summary_start == 0:
        return None
    length = size - tail - footer.summary_start
    if footer.summary_start < len(MAGIC) or not 0 < length <= MAX_RECORD_BYTES:
        raise BrokenRecord("the footer names no place in the file")
    stream.seek(footer.summary_start)
    summary = stream.read(length)
    # The checksum covers the summary and the footer up to the checksum itself.
    crc = zlib.crc32(end[: FRAME.size + 16], zlib.crc32(summary))
    if footer.summary_crc not in (0, crc):
        raise BrokenRecord("its checksum does not fit its content")
    return _parse_index(summary, stream, size, footer.summary_crc != 0)


def _parse_index(summary: bytes, stream: IO[bytes], size: int, checksummed: bool) -> Index | None:
    known = Definitions()
    statistics: Statistics | None = None
    chunks = _ListedChunks()
    for opcode, body in split(memoryview(summary)):
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            known.learn(opcode, body)
        elif opcode == Opcode.STATISTICS:
            statistics = parse(Statistics.read, body)
        elif opcode == Opcode.CHUNK_INDEX:
            chunks.add(parse(ChunkIndex.read, body))
    schemas, channels = known.schemas, known.channels
    if not channels or statistics is None:
        return None  # allowed, and of no use
    counts = dict(statistics.channel_message_counts)
    if any(c.schema_id and c.schema_id not in schemas for c in channels.values()):
        raise BrokenRecord("a channel's schema is missing")
    if statistics.channel_count != len(channels) or not set(counts) <= set(channels):
        raise BrokenRecord("its statistics are of other channels")
    sound = checksummed and chunks.cost <= _MAX_LISTED and statistics.chunk_count == len(chunks.ids_at)
    sound = sound and all(ids <= set(channels) for ids in chunks.distinct)
    listed: dict[int, frozenset[int] | None] = {}
    for offset in sorted(chunks.ids_at) if sound else ():
        stream.seek(min(offset, size))
        sound &= stream.read(1) == bytes([Opcode.CHUNK])
        listed[offset] = chunks.ids_at[offset] or None
    span_ns = statistics.message_start_time, statistics.message_end_time
    return Index(known, counts, *span_ns, listed if sound else {}, statistics.attachment_count, checksummed)


class _ListedChunks:
    """`ids_at`: offset of a chunk -> ids of its channels, one set for all chunks that have the same (`distinct`)."""

    def __init__(self) -> None:
        self.ids_at: dict[int, frozenset[int]] = {}
        self.distinct: dict[frozenset[int], frozenset[int]] = {}
        self.cost = 0  # chunks and members of sets; beyond _MAX_LISTED none is kept

    def add(self, chunk: ChunkIndex) -> None:
        ids = frozenset(chunk.message_index_offsets)
        self.cost += 1 + (0 if ids in self.distinct else len(ids))
        if self.cost > _MAX_LISTED:
            self.ids_at.clear()
            self.distinct.clear()
        else:
            self.ids_at[chunk.chunk_start_offset] = self.distinct.setdefault(ids, ids)
