"""Looks for the next record behind damage, block by block, in time that is bounded whatever the bytes are."""

import re
from collections.abc import Callable, Iterator
from enum import Enum

from mcap.opcode import Opcode

from .heads import MESSAGE_HEAD, PEEK_BYTES, can_follow, chunk_head, fields_add_up
from .records import RECORD_HEAD

_FIRST_BLOCK_BYTES, _BLOCK_BYTES = 2**12, 2**20
_MAX_CANDIDATES = 2**20  # some seconds; bytes that mean something else give a few in a megabyte
_LENGTH = rb".{3}[\0-\x08]\0{4}"  # at most MAX_RECORD_BYTES, little-endian
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
            head = chunk_head(start[RECORD_HEAD.size :])
            return head is not None and head.length == length
        if end > self._size:
            return False
        if opcode == Opcode.MESSAGE:
            known = length >= MESSAGE_HEAD.size
            known = known and self._knows_channel(MESSAGE_HEAD.unpack_from(start, RECORD_HEAD.size)[0])
            return known and can_follow(self._read(end, PEEK_BYTES), self._size - end)
        return fields_add_up(opcode, length, lambda at, count: self._read(body + at, count))

    def _read(self, at: int, count: int) -> bytes:
        return self._read_bytes(at, max(min(count, self._size - at), 0))
