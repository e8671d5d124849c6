"""The summary section at the end of an MCAP file, as far as it can be verified."""

import os
import struct
import zlib
from typing import IO

import msgspec
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer, Statistics

from ...system.inputs import LIMITS
from .definitions import Definitions
from .message import Damage
from .records import MAGIC, RECORD_HEAD, BrokenRecord, parse_record, split_records

_FOOTER_BYTES = 20  # fixed by the specification
_DATA_END = RECORD_HEAD.pack(Opcode.DATA_END, 4)
_CHUNK_HEAD = struct.Struct("<QQQ")  # first and last log time, uncompressed size


class Index(msgspec.Struct):
    """The content of the summary: schemas and channels, message counts by channel id, the span of log times.

    `counts` is empty if the summary has none. `chunk_channels`: offset of each chunk, ascending -> ids of the
    channels in it (None: unknown). It lists only chunks at their indexed places, and none if skipping one would be
    unsafe: without a checksum, or with more chunks than any recording has.
    """

    definitions: Definitions
    counts: dict[int, int]
    start_ns: int
    end_ns: int
    chunk_channels: dict[int, frozenset[int] | None]
    attachment_count: int
    checksummed: bool


def read_index(stream: IO[bytes], damage: Damage) -> Index | None:
    """Read the summary; None if the file has none, or one at a wrong place, which is added to `damage`.

    Raises BrokenRecord if it cannot be trusted.
    """
    size = os.fstat(stream.fileno()).st_size
    tail = RECORD_HEAD.size + _FOOTER_BYTES + len(MAGIC)
    if size < 2 * len(MAGIC) + tail:
        return None
    stream.seek(size - tail)
    end = stream.read(tail)
    if end[-len(MAGIC) :] != MAGIC or end[: RECORD_HEAD.size] != RECORD_HEAD.pack(Opcode.FOOTER, _FOOTER_BYTES):
        return None
    footer = parse_record(Footer.read, end[RECORD_HEAD.size : -len(MAGIC)])
    start = footer.summary_start
    if start == 0:
        return None
    before = len(_DATA_END) + 4  # the record that ends the messages, with its checksum
    stream.seek(max(start - before, 0) if start < size else size)
    if not stream.read(before).startswith(_DATA_END) or not start < size - tail <= start + LIMITS.record_bytes:
        damage.add("its index lies elsewhere than the file says: bytes before it are missing, or were added")
        return None
    summary = stream.read(size - tail - start)
    # The checksum covers the summary and the footer up to the checksum itself.
    if footer.summary_crc not in (0, zlib.crc32(end[: RECORD_HEAD.size + _FOOTER_BYTES - 4], zlib.crc32(summary))):
        raise BrokenRecord("its checksum does not match its content")
    return _parse(summary, stream, size, footer.summary_crc != 0, damage)


def _parse(summary: bytes, stream: IO[bytes], size: int, checksummed: bool, damage: Damage) -> Index | None:
    definitions, chunks = Definitions(), list[tuple[ChunkIndex, frozenset[int]]]()
    statistics: Statistics | None = None
    cost, distinct = 0, dict[frozenset[int], frozenset[int]]()  # equal sets of ids are stored once
    for opcode, body in split_records(memoryview(summary)):
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            definitions.add(opcode, body)
        elif opcode == Opcode.STATISTICS:
            statistics = parse_record(Statistics.read, body)
        elif opcode == Opcode.CHUNK_INDEX and checksummed and cost <= LIMITS.indexed:
            chunk = parse_record(ChunkIndex.read, body)
            ids = frozenset(chunk.message_index_offsets)
            cost += 1 + (0 if ids in distinct else len(ids))
            chunks.append((chunk, distinct.setdefault(ids, ids)))
            chunk.message_index_offsets = {}
    schemas, channels = definitions.schemas, definitions.channels
    if not channels or statistics is None:
        return None  # allowed by the specification, but useless
    counts = dict(statistics.channel_message_counts)
    if any(c.schema_id and c.schema_id not in schemas for c in channels.values()):
        raise BrokenRecord("a channel's schema is missing")
    if statistics.channel_count != len(channels) or not set(counts) <= set(channels):
        raise BrokenRecord("its statistics are of other channels")
    found: dict[int, frozenset[int] | None] = {}
    if cost <= LIMITS.indexed:
        for chunk, ids in sorted(chunks, key=lambda entry: entry[0].chunk_start_offset):
            if _has_chunk(stream, size, chunk):
                found[chunk.chunk_start_offset] = ids if ids and ids <= set(channels) else None
        if len(found) < len(chunks):
            where = f"{len(chunks) - len(found)} of {len(chunks)} chunks are not where it lists them"
            damage.note(f"its index does not fit the file: {where}")
    span_ns = statistics.message_start_time, statistics.message_end_time
    return Index(definitions, counts, *span_ns, found, statistics.attachment_count, checksummed)


def _has_chunk(stream: IO[bytes], size: int, chunk: ChunkIndex) -> bool:
    """Whether the chunk of an index entry begins at its indexed place."""
    length, offset = chunk.chunk_length - RECORD_HEAD.size, chunk.chunk_start_offset
    if length < _CHUNK_HEAD.size or not 0 < offset <= size - chunk.chunk_length:
        return False
    stream.seek(offset)
    times = chunk.message_start_time, chunk.message_end_time
    head = RECORD_HEAD.pack(Opcode.CHUNK, length) + _CHUNK_HEAD.pack(*times, chunk.uncompressed_size)
    return stream.read(len(head)) == head
