"""Recognises a record by its first bytes, also where nothing else says that one begins there.

A chunk gives its length twice, schemas, channels, attachments and metadata consist of fields whose lengths add up,
and a message belongs to a channel that is known. That is enough to find them in noise.
"""

import struct
from collections.abc import Callable
from typing import NamedTuple

from mcap.opcode import Opcode

from .records import MAX_RECORD_BYTES, RECORD_HEAD

MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel id, sequence, log time, publish time
PEEK_BYTES = 64  # of a record: enough for the head of a chunk and its compression
_CHUNK = struct.Struct("<QQQII")  # first and last log time, uncompressed size, CRC-32, length of the next field
_COMPRESSIONS = (b"", b"lz4", b"zstd")
_KNOWN = range(Opcode.HEADER, Opcode.DATA_END + 1)
# Bytes in front of the fields that begin with their length, the sizes of these lengths, and bytes behind.
_FIELDS: dict[int, tuple[int, tuple[int, ...], int]] = {
    Opcode.SCHEMA: (2, (4, 4, 4), 0),
    Opcode.CHANNEL: (4, (4, 4, 4), 0),
    Opcode.ATTACHMENT: (16, (4, 4, 8), 4),
    Opcode.METADATA: (0, (4, 4), 0),
}


class ChunkHead(NamedTuple):
    """The head of a chunk: `length` of its body by the fields in it, its first and its last log time."""

    length: int
    start_ns: int
    end_ns: int


def chunk_head(body: bytes) -> ChunkHead | None:
    """The head of a chunk by the first bytes of its body; None where they cannot be that."""
    if len(body) < _CHUNK.size:
        return None
    start_ns, end_ns, size, _, name_length = _CHUNK.unpack_from(body)
    data = _CHUNK.size + name_length
    if start_ns > end_ns or size > MAX_RECORD_BYTES or data + 8 > len(body):
        return None
    length = int.from_bytes(body[data : data + 8], "little")
    if body[_CHUNK.size : data] not in _COMPRESSIONS or length > MAX_RECORD_BYTES:
        return None
    return ChunkHead(data + 8 + length, start_ns, end_ns)


def can_follow(start: bytes, left: int) -> bool:
    """Whether bytes that follow a record begin another one; `left` of them are in the file.

    Where the file ends within the next record, that is no sign against it.
    """
    if len(start) < RECORD_HEAD.size:
        return True
    opcode, length = RECORD_HEAD.unpack_from(start)
    if opcode == Opcode.CHUNK and chunk_head(start[RECORD_HEAD.size :]) is not None:
        return True
    fits = RECORD_HEAD.size + length <= left
    return (fits and opcode != 0) or (opcode in _KNOWN and length <= MAX_RECORD_BYTES)


def fields_add_up(opcode: int, length: int, read: Callable[[int, int], bytes]) -> bool:
    """Whether the fields of a schema, channel, attachment or metadata record end where its body of `length` does.

    `read(at, count)` gives bytes of the body.
    """
    at, sizes, behind = _FIELDS[opcode]
    for size in sizes:
        if at + size > length:
            return False
        at += size + int.from_bytes(read(at, size), "little")
    return at + behind == length
