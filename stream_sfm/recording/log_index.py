"""The summary section at the end of an MCAP file, believed only as far as it can be checked."""

import os
import zlib
from dataclasses import dataclass
from typing import IO

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Schema, Statistics

from .framing import FRAME, MAGIC, MAX_RECORD_BYTES, BrokenRecord, parse, split


@dataclass(slots=True)
class Index:
    """What the summary says. `counts`: messages a channel id, empty where they are not told.

    `chunk_channels`: offset of each chunk, ascending -> ids of the channels with messages in it (None: not told).
    Whoever passes over a chunk or jumps to one has to be sure: it is empty where the summary carries no checksum,
    or is not of this file as it stands.
    """

    schemas: dict[int, Schema]
    channels: dict[int, Channel]
    counts: dict[int, int]
    start_ns: int
    end_ns: int
    chunk_channels: dict[int, frozenset[int] | None]
    attachment_count: int
    checksummed: bool


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
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    statistics: Statistics | None = None
    chunks: list[ChunkIndex] = []
    for opcode, body in split(memoryview(summary)):
        if opcode == Opcode.SCHEMA:
            schema = parse(Schema.read, body)
            schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = parse(Channel.read, body)
            channels[channel.id] = channel
        elif opcode == Opcode.STATISTICS:
            statistics = parse(Statistics.read, body)
        elif opcode == Opcode.CHUNK_INDEX:
            chunks.append(parse(ChunkIndex.read, body))
    if not channels or statistics is None:
        return None  # allowed, and of no use
    counts = dict(statistics.channel_message_counts)
    if any(c.schema_id and c.schema_id not in schemas for c in channels.values()):
        raise BrokenRecord("a channel's schema is missing")
    if statistics.channel_count != len(channels) or not set(counts) <= set(channels):
        raise BrokenRecord("its statistics are of other channels")
    sound = checksummed and statistics.chunk_count == len(chunks)
    for chunk in chunks:
        stream.seek(min(chunk.chunk_start_offset, size))
        sound &= stream.read(1) == bytes([Opcode.CHUNK]) and set(chunk.message_index_offsets) <= set(channels)
    chunks.sort(key=lambda c: c.chunk_start_offset)
    listed = {c.chunk_start_offset: frozenset(c.message_index_offsets) or None for c in chunks if sound}
    span_ns = statistics.message_start_time, statistics.message_end_time
    return Index(schemas, channels, counts, *span_ns, listed, statistics.attachment_count, checksummed)
