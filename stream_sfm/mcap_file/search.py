"""Recognises a record by its first bytes, and looks for the next one behind damage, in time that is bounded.

A chunk gives its length twice, schemas, channels, attachments and metadata consist of fields whose lengths add up,
and a message belongs to a channel that is known. That is enough to find them in noise.
"""

import re
import struct
from collections.abc import Callable, Iterator
from enum import Enum

from mcap.opcode import Opcode

from ..inputs import LIMITS
from .records import CHUNK_HEAD, RECORD_HEAD

MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel id, sequence, log time, publish time
PEEK_BYTES = 64  # of a record: enough for the head of a chunk and its compression
_COMPRESSIONS = (b"", b"lz4", b"zstd")
_KNOWN = range(Opcode.HEADER, Opcode.DATA_END + 1)
# Bytes in front of the fields that begin with their length, the sizes of these lengths, and bytes behind.
_FIELDS: dict[int, tuple[int, tuple[int, ...], int]] = {
    Opcode.SCHEMA: (2, (4, 4, 4), 0),
    Opcode.CHANNEL: (4, (4, 4, 4), 0),
    Opcode.ATTACHMENT: (16, (4, 4, 8), 4),
    Opcode.METADATA: (0, (4, 4), 0),
}
_FIRST_BLOCK_BYTES, _BLOCK_BYTES = 2**12, 2**20
_MAX_CANDIDATES = 2**20  # some seconds; bytes that mean something else give a few in a megabyte
_LENGTH = rb".{3}[\0-\x08]\0{4}"  # at most LIMITS.record_bytes, little-endian
_CHUNK = rb"\x06" + _LENGTH + rb".{16}" + _LENGTH + rb".{4}(?:\0{4}|\x03\0{3}lz4|\x04\0{3}zstd)"
_ATTACHED = rb"\x09" + _LENGTH + rb"|\x0c" + _LENGTH
_DEFINED = rb"\x03" + _LENGTH + rb"|\x04" + _LENGTH
_MESSAGE = rb"\x05" + _LENGTH


class Wanted(Enum):
    """What is looked for: attachments and metadata always, and chunks.

    In a damaged chunk that is not compressed, definitions and messages would be found that its checksum disowns.
    """

    CHUNKS = re.compile(_CHUNK, re.DOTALL)
    TOP_LEVEL = re.compile(rb"|".join((_CHUNK, _ATTACHED)), re.DOTALL)
    SUMMARY = re.compile(rb"|".join((_CHUNK, _ATTACHED, _DEFINED)), re.DOTALL)
    UNCHUNKED = re.compile(rb"|".join((_CHUNK, _ATTACHED, _DEFINED, _MESSAGE)), re.DOTALL)


class Search:
    """Finds records in `size` bytes. `read(at, count)` gives some; `knows_channel`: whether a channel is described."""

    def __init__(self, read: Callable[[int, int], bytes], size: int, knows_channel: Callable[[int], bool]) -> None:
        self._read_bytes, self._size, self._knows_channel = read, size, knows_channel
        self._candidates_left = _MAX_CANDIDATES

    def find(self, start: int, stop: int, wanted: Wanted) -> int | None:
        """The offset of the first record of a wanted kind that begins in [start, stop)."""
        for at in self._candidates(start, stop, wanted.value):
            if self._is_record(at):
                return at
            self._candidates_left -= 1
        return None

    def _candidates(self, start: int, stop: int, pattern: re.Pattern[bytes]) -> Iterator[int]:
        count = _FIRST_BLOCK_BYTES
        while start < stop:
            count = min(2 * count, _BLOCK_BYTES, stop - start)
            block = self._read(start, count + PEEK_BYTES)
            if block.count(0) < len(block):  # zeros are what some file systems leave of an open file: gigabytes
                at = -1
                while (match := pattern.search(block, at + 1)) is not None and (at := match.start()) < count:
                    if self._candidates_left <= 0:
                        return
                    yield start + at
            start += count

    def _is_record(self, at: int) -> bool:
        start = self._read(at, PEEK_BYTES)
        opcode, length = RECORD_HEAD.unpack_from(start)
        body, end = at + RECORD_HEAD.size, at + RECORD_HEAD.size + length
        if opcode == Opcode.CHUNK:  # it may be cut off
            return chunk_length(start[RECORD_HEAD.size :]) == length
        if end > self._size:
            return False
        if opcode == Opcode.MESSAGE:
            known = length >= MESSAGE_HEAD.size
            known = known and self._knows_channel(MESSAGE_HEAD.unpack_from(start, RECORD_HEAD.size)[0])
            return known and can_follow(self._read(end, PEEK_BYTES), self._size - end)
        return fields_add_up(opcode, length, lambda at, count: self._read(body + at, count))

    def _read(self, at: int, count: int) -> bytes:
        return self._read_bytes(at, max(min(count, self._size - at), 0))


def chunk_length(body: bytes) -> int | None:
    """The length of the body of a chunk by the fields in its first bytes; None where they cannot be that."""
    if len(body) < CHUNK_HEAD.size:
        return None
    start_ns, end_ns, size, _, name_length = CHUNK_HEAD.unpack_from(body)
    data = CHUNK_HEAD.size + name_length
    if start_ns > end_ns or size > LIMITS.record_bytes or data + 8 > len(body):
        return None
    length = int.from_bytes(body[data : data + 8], "little")
    if body[CHUNK_HEAD.size : data] not in _COMPRESSIONS or length > LIMITS.record_bytes:
        return None
    return data + 8 + length


def can_follow(start: bytes, left: int) -> bool:
    """Whether bytes that follow a record begin another one; `left` of them are in the file.

    Where the file ends within the next record, that is no sign against it.
    """
    if len(start) < RECORD_HEAD.size:
        return True
    opcode, length = RECORD_HEAD.unpack_from(start)
    if opcode == Opcode.CHUNK and chunk_length(start[RECORD_HEAD.size :]) is not None:
        return True
    fits = RECORD_HEAD.size + length <= left
    return (fits and opcode != 0) or (opcode in _KNOWN and length <= LIMITS.record_bytes)


def fields_add_up(opcode: int, length: int, read: Callable[[int, int], bytes]) -> bool:
    """Whether the fields of a schema, channel, attachment or metadata record end where its body of `length` does."""
    at, sizes, behind = _FIELDS[opcode]
    for size in sizes:
        if at + size > length:
            return False
        at += size + int.from_bytes(read(at, size), "little")
    return at + behind == length
