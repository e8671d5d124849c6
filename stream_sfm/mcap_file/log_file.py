"""One MCAP file, read in file order: one path for whole, unindexed, damaged and cut-off files.

What is wrong is collected in `Damage`. Messages before the damage are delivered, and so are those behind it wherever
the start of a record is known again: after a damaged body, or at the next chunk that a trusted index lists.
"""

import os
import struct
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import IO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Schema

from ..errors import LogError
from ..inputs import open_regular
from .chunks import Allowance, decompress_chunk
from .damage import Damage
from .definitions import Definitions
from .index import Index, read_index
from .records import (
    MAGIC,
    MAX_RECORD_BYTES,
    RECORD_HEAD,
    BrokenRecord,
    RecordTooLarge,
    parse_record,
    split_records,
)

_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel id, sequence, log time, publish time
_READ = (Opcode.MESSAGE, Opcode.CHUNK, Opcode.CHANNEL, Opcode.SCHEMA)
_MAX_HEADER_BYTES = 2**16  # profile and library name, a few dozen bytes
_MAX_ATTACHMENT_BYTES = 2**20  # attachments are read whole; a calibration is kilobytes


class LogMessage(NamedTuple):
    """One message as stored: `channel` and `schema` (None: schemaless) describe the bytes in `data`."""

    channel: Channel
    schema: Schema | None
    log_time_ns: int
    data: bytes


class _Record(NamedTuple):
    """A record in the file; fewer than `length` bytes are `available` where the file is cut off or damaged."""

    offset: int
    opcode: int
    length: int
    available: int


class LogFile:
    """One MCAP file, opened anew for every reading, so that readings do not disturb each other.

    `index` is None where the file has none that can be trusted; `index_problem` then says why, and is empty where the
    file simply has none. Raises LogError where the path cannot be opened, is empty, or is not MCAP.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        with self._open() as stream:
            try:
                self.size = os.fstat(stream.fileno()).st_size
                start = stream.read(len(MAGIC))
                if self.size == 0:
                    raise LogError(f"{self.path} is empty (0 bytes): nothing was recorded")
                if start != MAGIC:
                    version = " of this version" if start.startswith(MAGIC[:5]) else ""
                    raise LogError(f"{self.path} is not an MCAP file{version}; its first bytes are {start!r}")
                self.index, self.index_problem = _read_index(stream)
            except OSError as error:
                raise LogError(f"cannot read {self.path}: {error.strerror}") from None

    def _open(self) -> IO[bytes]:
        try:
            return open_regular(self.path, 1 << 18)
        except OSError as error:
            raise LogError(f"cannot read {self.path}: {error.strerror}") from None

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[LogMessage]:
        """Yield the messages of `topics` (None: all) in file order; what cannot be read is added to `damage`.

        With `topics` given, chunks in which the index lists none of them are not even opened.
        """
        read: Counter[int] = Counter()
        if self.index_problem:
            damage.notes.append(f"{self.path}: its index is not used: {self.index_problem}")
        try:
            for message in self._messages(damage, topics):
                read[message.channel.id] += 1
                yield message
        except OSError as error:  # a failing disk, a network share that went away
            damage.add(f"{self.path}: reading failed after byte {damage.bytes_read}: {error.strerror}")
        if damage.complete and self.index is not None:
            for channel_id, count in self.index.counts.items():
                topic = self.index.channels[channel_id].topic
                if (topics is None or topic in topics) and read[channel_id] < count:
                    damage.add(f"{self.path}: {read[channel_id]} of {count} messages of {topic} could be read")

    def _messages(self, damage: Damage, topics: frozenset[str] | None) -> Iterator[LogMessage]:
        # The index's definitions serve where the chunk that first described a channel is damaged.
        parser = _Parser(self.index.definitions.copy() if self.index else Definitions(), topics, damage)
        allowance = Allowance()
        with self._open() as stream:
            for record in self._records(stream, damage):
                if record.opcode not in _READ or self._can_skip(record, topics):
                    continue
                where = f"{self.path} at byte {record.offset}"
                whole = record.available == record.length
                try:
                    body = stream.read(record.available)
                    if record.opcode == Opcode.CHUNK:
                        allowance.begin(body)
                        for opcode, inner in split_records(memoryview(decompress_chunk(body, whole))):
                            allowance.take_record()
                            if (message := parser.parse(opcode, inner, where)) is not None:
                                yield message
                    elif whole and (message := parser.parse(record.opcode, body, where)) is not None:
                        yield message
                except BrokenRecord as error:
                    if whole:  # else the cut has been noted
                        kind = "chunk" if record.opcode == Opcode.CHUNK else "record"
                        damage.add(f"{where}: a damaged {kind} of {record.length} bytes was skipped: {error}")

    def _can_skip(self, record: _Record, topics: frozenset[str] | None) -> bool:
        """Whether the index shows that a chunk holds nothing of these topics."""
        if topics is None or self.index is None or record.opcode != Opcode.CHUNK:
            return False
        listed = self.index.chunk_channels.get(record.offset)
        return listed is not None and not any(self.index.channels[i].topic in topics for i in listed)

    def _records(self, stream: IO[bytes], damage: Damage) -> Iterator[_Record]:
        """Yield the records in order; `stream` stands at the body of the one yielded.

        A record never reaches into a chunk that the index lists: where one claims to, reading resumes at that chunk.
        """
        chunks = list(self.index.chunk_channels) if self.index else []
        at = len(MAGIC)
        data_ended = False
        while True:
            damage.bytes_read = self.size if data_ended else at
            number = bisect_right(chunks, at)
            next_chunk = chunks[number] if number < len(chunks) else None
            stream.seek(at)
            head = stream.read(RECORD_HEAD.size)
            left = (next_chunk or self.size) - at - RECORD_HEAD.size
            opcode, length = RECORD_HEAD.unpack(head) if left >= 0 and len(head) == RECORD_HEAD.size else (0, 0)
            problem = ""
            if left < 0 and next_chunk is None:
                problem = "the recording was not closed"
            elif opcode == 0:
                problem = "there is no record (zeros, or damage)"
            elif length > left:
                problem = f"the record there has {length} bytes, only {left} follow"
                # A chunk can be read as far as it goes; anything else that declares so much is of no use.
                if opcode == Opcode.CHUNK and left <= MAX_RECORD_BYTES:
                    yield _Record(at, opcode, length, left)
            elif length > MAX_RECORD_BYTES and opcode in _READ:
                damage.add(f"{self.path} at byte {at}: a record of {length / 2**20:.0f} MiB was skipped")
            elif opcode == Opcode.FOOTER and (data_ended or left - length == len(MAGIC)):
                damage.bytes_read = self.size
                return
            else:
                # Behind the data follows the summary; looking for messages in it costs nothing.
                data_ended |= opcode == Opcode.DATA_END and next_chunk is None
                yield _Record(at, opcode, length, length)
            if not problem:
                at += RECORD_HEAD.size + length
            elif next_chunk is not None:
                damage.add(f"{self.path} is damaged at byte {at}: {problem}; read on at byte {next_chunk}")
                at = next_chunk
            else:
                if not data_ended:
                    self._note_cut(damage, at, problem)
                return

    def _note_cut(self, damage: Damage, at: int, problem: str) -> None:
        share = f"{at / 1e6:.2f} of {self.size / 1e6:.2f} MB ({100 * at / self.size:.0f} %) could be read"
        damage.add(f"{self.path} is cut off or damaged at byte {at}: {problem}; {share}")

    def attachments(self, damage: Damage, max_bytes: int = _MAX_ATTACHMENT_BYTES) -> Iterator[Attachment]:
        """Yield the attachments of at most `max_bytes`, in file order."""
        if self.index is not None and self.index.attachment_count == 0:
            return
        with self._open() as stream:
            for record in self._records(stream, damage):
                if record.opcode == Opcode.ATTACHMENT and record.length <= max_bytes:
                    try:
                        yield parse_record(Attachment.read, stream.read(record.length))
                    except BrokenRecord as error:
                        damage.add(
                            f"{self.path} at byte {record.offset}: a damaged attachment was skipped: {error}"
                        )

    def header(self) -> Header | None:
        """The header record, or None where it is damaged."""
        with self._open() as stream:
            record = next(self._records(stream, Damage()), None)
            if record is None or record.opcode != Opcode.HEADER or record.length > _MAX_HEADER_BYTES:
                return None
            try:
                header: Header = parse_record(Header.read, stream.read(record.length))
            except BrokenRecord:
                return None
            return header


class _Parser:
    """Turns the records of one reading into messages of the wanted topics, and collects schemas and channels."""

    def __init__(self, definitions: Definitions, topics: frozenset[str] | None, damage: Damage) -> None:
        self._definitions, self._topics, self._damage = definitions, topics, damage

    def parse(self, opcode: int, body: bytes | memoryview, where: str) -> LogMessage | None:
        """The message in a record, if it is of a wanted topic. Raises BrokenRecord."""
        if opcode == Opcode.MESSAGE:
            return self._message(body, where)
        if opcode in (Opcode.CHANNEL, Opcode.SCHEMA):
            try:
                self._definitions.add(opcode, body)
            except RecordTooLarge as error:  # the rest of its chunk can still be read
                self._damage.add(f"{where}: skipped: {error}")
        return None

    def _message(self, body: bytes | memoryview, where: str) -> LogMessage | None:
        if len(body) < _MESSAGE_HEAD.size:
            raise BrokenRecord("a message shorter than its header")
        channel_id, _, log_time_ns, _ = _MESSAGE_HEAD.unpack_from(body)
        channel = self._definitions.channels.get(channel_id)
        if channel is None:
            self._damage.add(f"{where}: messages of channel {channel_id}, which is not described, were skipped")
            return None
        if self._topics is not None and channel.topic not in self._topics:
            return None
        data = bytes(body[_MESSAGE_HEAD.size :])  # a copy: a view would keep its whole chunk in memory
        return LogMessage(channel, self._definitions.schemas.get(channel.schema_id), log_time_ns, data)


def _read_index(stream: IO[bytes]) -> tuple[Index | None, str]:
    try:
        return read_index(stream), ""
    except BrokenRecord as error:
        return None, str(error)
