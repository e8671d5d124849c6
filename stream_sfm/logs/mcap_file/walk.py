"""Goes through the records of an MCAP file, intact or damaged; after damage, at the next recognisable one.

A record is recognised by its first bytes: a chunk gives its length twice, schemas, channels, attachments and metadata
consist of fields whose lengths add up, and a message belongs to a known channel. This is enough to find them
in noise. Records found twice are used once, in bounded time: at most as many bytes as the file has are examined again.
"""

import errno
import re
import struct
from collections.abc import Callable, Iterator
from enum import Enum
from functools import partial
from pathlib import Path
from typing import IO, NamedTuple

from mcap.opcode import Opcode

from ...system.inputs import LIMITS
from .message import Damage
from .records import CHUNK_HEAD, MAGIC, RECORD_HEAD, ends_with_magic

READ = (Opcode.MESSAGE, Opcode.CHUNK, Opcode.CHANNEL, Opcode.SCHEMA)
_DEFINITIONS = (Opcode.SCHEMA, Opcode.CHANNEL)
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel id, sequence, log time, publish time
PEEK_BYTES = 64  # per record: enough for the head of a chunk and its compression
_COMPRESSIONS = (b"", b"lz4", b"zstd")
_KNOWN = range(Opcode.HEADER, Opcode.DATA_END + 1)
# Bytes before the fields that begin with their length, the sizes of these lengths, and bytes after them.
_FIELDS: dict[int, tuple[int, tuple[int, ...], int]] = {
    Opcode.SCHEMA: (2, (4, 4, 4), 0),
    Opcode.CHANNEL: (4, (4, 4, 4), 0),
    Opcode.ATTACHMENT: (16, (4, 4, 8), 4),
    Opcode.METADATA: (0, (4, 4), 0),
}
_FIRST_BLOCK_BYTES, _BLOCK_BYTES = 2**12, 2**20
_MAX_CANDIDATES = 2**20  # some seconds; other bytes give a few candidates per megabyte
_LENGTH = rb".{3}[\0-\x08]\0{4}"  # at most LIMITS.record_bytes, little-endian
_CHUNK = rb"\x06" + _LENGTH + rb".{16}" + _LENGTH + rb".{4}(?:\0{4}|\x03\0{3}lz4|\x04\0{3}zstd)"
_ATTACHED = rb"\x09" + _LENGTH + rb"|\x0c" + _LENGTH
_DEFINED = rb"\x03" + _LENGTH + rb"|\x04" + _LENGTH
_MESSAGE = rb"\x05" + _LENGTH


class Wanted(Enum):
    """The kinds of records that are sought: attachments and metadata always, and chunks.

    In a damaged uncompressed chunk, the search would also find definitions and messages that its checksum disproves.
    """

    CHUNKS = re.compile(_CHUNK, re.DOTALL)
    TOP_LEVEL = re.compile(rb"|".join((_CHUNK, _ATTACHED)), re.DOTALL)
    SUMMARY = re.compile(rb"|".join((_CHUNK, _ATTACHED, _DEFINED)), re.DOTALL)
    UNCHUNKED = re.compile(rb"|".join((_CHUNK, _ATTACHED, _DEFINED, _MESSAGE)), re.DOTALL)


class Record(NamedTuple):
    """A record in the file; fewer than `length` bytes are `available` if the file is cut off or damaged."""

    offset: int
    opcode: int
    length: int
    available: int

    @property
    def whole(self) -> bool:
        """Whether all of it is available."""
        return self.available == self.length


class Walk:
    """The records of a file in order; iterate once. Problems are added to `damage`.

    `knows_channel`: whether a channel is described, which is asked in the search for messages after damage.
    """

    def __init__(
        self, path: Path, stream: IO[bytes], size: int, damage: Damage, knows_channel: Callable[[int], bool]
    ) -> None:
        self._path, self._stream, self._size, self._damage = path, stream, size, damage
        # Not a method, as a cycle would keep the definitions of each reading until the garbage is collected.
        self._read = partial(_read, stream)
        self._search = Search(self._read, size, knows_channel)
        self._at: int | None = len(MAGIC)  # None: the end
        self._unconfirmed: int | None = None  # the record before `_at`, if only the next record can confirm it
        self._has_chunks: bool | None = None  # not known
        self._data_ended = False
        self._second_looks = size

    def __iter__(self) -> Iterator[Record]:
        """Yield the records. Raises OSError if the file cannot be read."""
        while (at := self._at) is not None:
            self._damage.bytes_read = self._size if self._data_ended else at
            start, left = self._peek(at), self._size - at - RECORD_HEAD.size
            opcode, length = RECORD_HEAD.unpack_from(start) if left >= 0 else (0, 0)
            opcode, length = self._as_chunk(at, opcode, length, left, start[RECORD_HEAD.size :])
            if opcode == Opcode.FOOTER and left - length == len(MAGIC):
                self._damage.bytes_read = self._size
                return
            if problem := self._problem(opcode, length, left, start):
                # A chunk that is cut off with the file can be read up to the cut. Anything else that claims so much
                # is of no use, nor is a chunk that lacks bytes somewhere: its checksum cannot tell where.
                cut = 0 <= left < length and not ends_with_magic(self._stream)
                if cut and opcode == Opcode.CHUNK and left <= LIMITS.record_bytes:
                    yield Record(at, opcode, length, left)
                    self._unconfirmed = None
                self._resume(at, problem)
                continue
            if opcode == Opcode.CHUNK:
                self._has_chunks = True
            if opcode in (Opcode.CHUNK, Opcode.MESSAGE, Opcode.DATA_END):
                self._data_ended = opcode == Opcode.DATA_END
            self._unconfirmed = None if opcode == Opcode.CHUNK else at
            self._at = at + RECORD_HEAD.size + length
            if length > LIMITS.record_bytes and opcode in READ:
                self._damage.add(f"{self._path} at byte {at}: a record of {length / 2**20:.0f} MiB was skipped")
            else:
                yield Record(at, opcode, length, length)

    def body(self, record: Record) -> bytes:
        """Return the available bytes of the record that was yielded last. Raises OSError."""
        return self._read(record.offset + RECORD_HEAD.size, record.available)

    def reject(self, record: Record) -> None:
        """Look for records inside the one that was yielded last: its body is damaged, and so perhaps is its length."""
        end = record.offset + RECORD_HEAD.size + record.available
        if self._allows(end - record.offset):
            found = self._search.find(record.offset + 1, end, self._wanted(record.offset))
            if found is not None:
                self._damage.add(f"{self._path} at byte {found}: a record begins inside a damaged one; it was read")
                self._at, self._unconfirmed = found, None

    def _as_chunk(self, at: int, opcode: int, length: int, left: int, body: bytes) -> tuple[int, int]:
        """Return kind and length of a record; those of a chunk if its content shows that they are wrong."""
        found = chunk_length(body) if length or opcode else None
        if found is None or found > left or (opcode, length) == (Opcode.CHUNK, found):
            return opcode, length
        behind = at + RECORD_HEAD.size + found
        if opcode != Opcode.CHUNK and length == found:
            wrong = f"kind, {opcode},"
        elif opcode == Opcode.CHUNK and can_follow(self._peek(behind), self._size - behind):
            wrong = f"length, {length},"
        else:
            return opcode, length
        self._damage.note(f"{self._path} at byte {at}: a chunk was read although its {wrong} is wrong")
        return int(Opcode.CHUNK), found

    def _problem(self, opcode: int, length: int, left: int, start: bytes) -> str:
        """Return the reason why there is no record; empty if there is one."""
        if left < 0:
            return "the recording was not closed"
        if opcode == 0:
            return "there is no record (zeros, or damage)"
        if length > left:
            return f"the record there has {length} bytes, only {left} follow"
        if self._unconfirmed is not None and not can_follow(start, RECORD_HEAD.size + left):
            return "there is no record"
        return ""

    def _resume(self, at: int, problem: str) -> None:
        """Resume at the next record after damage."""
        start = at + 1
        if self._unconfirmed is not None and self._allows(at - self._unconfirmed):
            start = self._unconfirmed + 1  # its length may have been too large
        self._unconfirmed = None
        self._at = found = self._search.find(start, self._size, self._wanted(at))
        if found is None:
            if not self._data_ended:
                share = f"{at / 1e6:.2f} of {self._size / 1e6:.2f} MB ({100 * at / self._size:.0f} %) could be read"
                self._damage.add(f"{self._path} is cut off or damaged at byte {at}: {problem}; {share}")
        elif not self._data_ended or self._peek(found)[0] not in _DEFINITIONS:  # a summary also has them
            self._data_ended = False
            self._damage.add(f"{self._path} is damaged at byte {at}: {problem}; read on at byte {found}")

    def _wanted(self, at: int) -> Wanted:
        """Return the kinds of records that may follow damage at `at`."""
        if self._has_chunks is None:
            self._has_chunks = self._search.find(at, self._size, Wanted.CHUNKS) is not None
        if not self._has_chunks:
            return Wanted.UNCHUNKED
        return Wanted.SUMMARY if self._data_ended else Wanted.TOP_LEVEL

    def _allows(self, count: int) -> bool:
        """Whether this many bytes may be examined a second time."""
        self._second_looks -= count
        return self._second_looks >= 0

    def _peek(self, at: int) -> bytes:
        return self._read(at, min(PEEK_BYTES, self._size - at))


def _read(stream: IO[bytes], at: int, count: int) -> bytes:
    stream.seek(at)
    data = stream.read(count)
    if len(data) < count:
        raise OSError(errno.EIO, "it became shorter while it was read")
    return data


class Search:
    """Finds records in `size` bytes. `read(at, count)` returns some of them; `knows_channel`: is it described?"""

    def __init__(self, read: Callable[[int, int], bytes], size: int, knows_channel: Callable[[int], bool]) -> None:
        self._read_bytes, self._size, self._knows_channel = read, size, knows_channel
        self._candidates_left = _MAX_CANDIDATES

    def find(self, start: int, stop: int, wanted: Wanted) -> int | None:
        """Return the offset of the first record of a wanted kind that begins in [start, stop)."""
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
            if block.count(0) < len(block):  # some file systems leave gigabytes of zeros of an open file
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
    """Return the length of the body of a chunk by the fields in its first bytes; None if these are not valid."""
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
    """Whether the bytes after a record begin another one; `left` of them are in the file.

    If the file ends within the next record, this is not evidence against it.
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
