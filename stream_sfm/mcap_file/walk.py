"""Goes through the records of an MCAP file, whole or damaged: behind damage at the next record that can be recognised.

What is found twice is taken once, in bounded time: a file can make it look again at as many bytes as it has.
"""

import errno
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import IO, NamedTuple

from mcap.opcode import Opcode

from ..inputs import LIMITS
from .message import Damage
from .records import MAGIC, RECORD_HEAD, ends_with_magic
from .search import PEEK_BYTES, Search, Wanted, can_follow, chunk_length

READ = (Opcode.MESSAGE, Opcode.CHUNK, Opcode.CHANNEL, Opcode.SCHEMA)
_DEFINITIONS = (Opcode.SCHEMA, Opcode.CHANNEL)


class Record(NamedTuple):
    """A record in the file; fewer than `length` bytes are `available` where the file is cut off or damaged."""

    offset: int
    opcode: int
    length: int
    available: int

    @property
    def whole(self) -> bool:
        """Whether all of it is there."""
        return self.available == self.length


class Walk:
    """The records of a file in order; iterate once. What is wrong is added to `damage`.

    `knows_channel`: whether a channel is described, asked where messages are looked for behind damage.
    """

    def __init__(
        self, path: Path, stream: IO[bytes], size: int, damage: Damage, knows_channel: Callable[[int], bool]
    ) -> None:
        self._path, self._stream, self._size, self._damage = path, stream, size, damage
        # Not a method: a cycle would keep the definitions of each reading until garbage is collected.
        self._read = partial(_read, stream)
        self._search = Search(self._read, size, knows_channel)
        self._at: int | None = len(MAGIC)  # None: the end
        self._unconfirmed: int | None = None  # the record before `_at`, if nothing but what follows can confirm it
        self._has_chunks: bool | None = None  # not known
        self._data_ended = False
        self._second_looks = size

    def __iter__(self) -> Iterator[Record]:
        """Yield the records. Raises OSError where the file cannot be read."""
        while (at := self._at) is not None:
            self._damage.bytes_read = self._size if self._data_ended else at
            start, left = self._peek(at), self._size - at - RECORD_HEAD.size
            opcode, length = RECORD_HEAD.unpack_from(start) if left >= 0 else (0, 0)
            opcode, length = self._as_chunk(at, opcode, length, left, start[RECORD_HEAD.size :])
            if opcode == Opcode.FOOTER and left - length == len(MAGIC):
                self._damage.bytes_read = self._size
                return
            if problem := self._problem(opcode, length, left, start):
                # A chunk that is cut off with the file can be read as far as it goes. Anything else that claims so
                # much is of no use, nor is a chunk that lacks bytes somewhere: its checksum cannot tell where.
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
        """The available bytes of the record that was yielded last. Raises OSError."""
        return self._read(record.offset + RECORD_HEAD.size, record.available)

    def reject(self, record: Record) -> None:
        """Look for records inside the one that was yielded last: its body is damaged, and so its length may be."""
        end = record.offset + RECORD_HEAD.size + record.available
        if self._allows(end - record.offset):
            found = self._search.find(record.offset + 1, end, self._wanted(record.offset))
            if found is not None:
                self._damage.add(f"{self._path} at byte {found}: a record begins inside a damaged one; it was read")
                self._at, self._unconfirmed = found, None

    def _as_chunk(self, at: int, opcode: int, length: int, left: int, body: bytes) -> tuple[int, int]:
        """The kind and the length of a record, that of a chunk where its content shows that they are wrong."""
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
        """Why there is no record; empty where there is one."""
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
        """Go on at the next record behind damage."""
        start = at + 1
        if self._unconfirmed is not None and self._allows(at - self._unconfirmed):
            start = self._unconfirmed + 1  # it may have been taken for longer than it is
        self._unconfirmed = None
        self._at = found = self._search.find(start, self._size, self._wanted(at))
        if found is None:
            if not self._data_ended:
                share = f"{at / 1e6:.2f} of {self._size / 1e6:.2f} MB ({100 * at / self._size:.0f} %) could be read"
                self._damage.add(f"{self._path} is cut off or damaged at byte {at}: {problem}; {share}")
        elif not self._data_ended or self._peek(found)[0] not in _DEFINITIONS:  # a summary has them as well
            self._data_ended = False
            self._damage.add(f"{self._path} is damaged at byte {at}: {problem}; read on at byte {found}")

    def _wanted(self, at: int) -> Wanted:
        """What can be behind damage at `at`."""
        if self._has_chunks is None:
            self._has_chunks = self._search.find(at, self._size, Wanted.CHUNKS) is not None
        if not self._has_chunks:
            return Wanted.UNCHUNKED
        return Wanted.SUMMARY if self._data_ended else Wanted.TOP_LEVEL

    def _allows(self, count: int) -> bool:
        """Whether so many bytes may be looked at a second time."""
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
