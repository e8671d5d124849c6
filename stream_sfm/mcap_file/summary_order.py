"""Reorders the end of an MCAP file so that rosbags, and with it evo, can read it too.

rosbags (0.11) reads the summary of a file up to its first SummaryOffset record and fails with a KeyError on a
schema that is not ROS 2 (protobuf, JSON). So the ROS 2 schemas and channels come first, then statistics and
indexes, one SummaryOffset, and the other schemas and channels last. Readers that go through the whole summary (the
mcap libraries of Python, Rust and TypeScript: Foxglove, Rerun) find everything; the specification would like
schemas and channels each in one run, which this order gives up.
"""

import struct
import zlib
from collections.abc import Iterator

from mcap.opcode import Opcode
from mcap.well_known import SchemaEncoding

from .records import MAGIC, RECORD_HEAD

_FOOTER = struct.Struct("<BQQQI")  # record head, start of the summary, start of its offsets (0: none), CRC-32
_SUMMARY_OFFSET = struct.Struct("<BQBQQ")  # record head, opcode of the group, its start, its length
_RECORD_ID = struct.Struct("<H")


def reorder_summary(tail: bytes, offset: int) -> bytes:
    """Reorder what `mcap.writer.Writer.finish` wrote at file position `offset`, from DataEnd to the magic.

    The writer must have been told to write no summary offsets.
    """
    records = list(_records(tail[: -len(MAGIC)]))
    data_end, summary = records[0], records[1:-1]  # the last one is the footer
    ros_schemas = {_id(r) for r in summary if r[0] == Opcode.SCHEMA and _encoding(r) == SchemaEncoding.ROS2}
    first: list[bytes] = []
    last: list[bytes] = []
    indexes: list[bytes] = []
    for record in summary:
        if record[0] == Opcode.SCHEMA:
            (first if _id(record) in ros_schemas else last).append(record)
        elif record[0] == Opcode.CHANNEL:
            (first if _schema_id(record) in ros_schemas else last).append(record)
        else:
            indexes.append(record)
    start = offset + len(data_end)
    head = b"".join(first)
    statistics = next(r for r in indexes if r[0] == Opcode.STATISTICS)
    indexes.remove(statistics)
    group_offset = _SUMMARY_OFFSET.pack(
        Opcode.SUMMARY_OFFSET, 17, Opcode.STATISTICS, start + len(head), len(statistics)
    )
    body = head + statistics + b"".join(indexes) + group_offset + b"".join(last)
    footer = _FOOTER.pack(Opcode.FOOTER, 20, start, 0, 0)[:-4]
    crc = zlib.crc32(footer, zlib.crc32(body))
    return data_end + body + footer + struct.pack("<I", crc) + MAGIC


def _records(data: bytes) -> Iterator[bytes]:
    """Yield the records, each with its head."""
    at = 0
    while at < len(data):
        length = RECORD_HEAD.unpack_from(data, at)[1] + RECORD_HEAD.size
        yield data[at : at + length]
        at += length


def _id(record: bytes) -> int:
    return int(_RECORD_ID.unpack_from(record, RECORD_HEAD.size)[0])


def _schema_id(channel: bytes) -> int:
    return int(_RECORD_ID.unpack_from(channel, RECORD_HEAD.size + 2)[0])


def _encoding(schema: bytes) -> str:
    at = RECORD_HEAD.size + 2
    at += 4 + struct.unpack_from("<I", schema, at)[0]  # the name
    length = struct.unpack_from("<I", schema, at)[0]
    return schema[at + 4 : at + 4 + length].decode()
