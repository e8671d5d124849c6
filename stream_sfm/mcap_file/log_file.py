"""MCAP messages in the order of the file: one path for whole, unindexed, damaged and cut-off files.

What is found wrong is collected in `Damage`; messages before it are delivered, and those after it wherever a
record's beginning is known again: behind a damaged body, or at the next chunk that a sound index lists.
"""

import os
import struct
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Schema

from ..errors import LogError
from .chunks import inflate
from .definitions import Definitions, TooMuch
from .index import Index, read_index
from .records import FRAME, MAGIC, MAX_RECORD_BYTES, BrokenRecord, parse, split

_MESSAGE = struct.Struct("<HIQQ")
_READ = (Opcode.MESSAGE, Opcode.CHUNK, Opcode.CHANNEL, Opcode.SCHEMA)
_MAX_NOTES = 20


class LogMessage(NamedTuple):
    """One message as stored: `channel` and `schema` (None: schemaless) describe the bytes in `data`."""

    channel: Channel
    schema: Schema | None
    log_time_ns: int
    data: bytes


@dataclass(slots=True)
class Damage:
    """What one reading of a log met: `notes` for people; `complete` is false once anything was lost."""

    complete: bool = True
    bytes_read: int = 0
    notes: list[str] = field(default_factory=list)

    def add(self, note: str) -> None:
        """Something was lost."""
        self.complete = False
        if len(self.notes) < _MAX_NOTES and note not in self.notes:
            self.notes.append(note)


class _Record(NamedTuple):
    """A record in the file; fewer than `length` bytes are `available` where the file is cut off or damaged."""

    offset: int
    opcode: int
    length: int
    available: int


class LogFile:
    """One MCAP file, opened anew for every reading, so that readings do not disturb each other.

    `index` is None where the file has none that can be believed; `index_problem` then says why, empty where there
    simply is none. Raises LogError where the path cannot be opened,
    is empty, or is not MCAP.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        try:
            str(self.path).encode()
        except UnicodeEncodeError:  # it could not be named in any result
            raise LogError(f"{str(self.path)!a}: the name of the file is not UTF-8: rename it") from None
        if self.path.is_dir():
            raise LogError(
                f"{self.path} is a folder: give a log (.mcap), or import its images into one",
                hint=("import_images",),
            )
        with self._open() as stream:
            try:
                self.size = os.fstat(stream.fileno()).st_size
                start = stream.read(len(MAGIC))
                if self.size == 0:
                    raise LogError(f"{self.path} is empty (0 bytes): the recording was never written")
                if start != MAGIC:
                    kind = _other_format(start)
                    raise LogError(f"{self.path} is not an MCAP file{kind}; its first bytes are {start!r}")
                self.index, self.index_problem = _index(stream)
            except OSError as error:
                raise LogError(f"cannot read {self.path}: {error.strerror}") from None

    def _open(self) -> IO[bytes]:
        try:
            return open(self.path, "rb", buffering=1 << 18)
        except OSError as error:
            raise LogError(f"cannot read {self.path}: {error.strerror}") from None

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[LogMessage]:
        """All messages of `topics` (None: all) in file order. What cannot be read is noted in `damage`.

        With `topics` given, chunks in which the index lists none of them are passed over unopened.
        """
        read: Counter[int] = Counter()
        if self.index_problem:
            damage.notes.append(f"{self.path}: its index is not used: {self.index_problem}")
        try:
            for message in self._messages(damage, topics):
                read[message.channel.id] += 1
                yield message
        except OSError as error:  # a failing disk, a share that went away
            damage.add(f"{self.path}: reading failed after byte {damage.bytes_read}: {error.strerror}")
        if damage.complete and self.index is not None:
            for channel_id, count in self.index.counts.items():
                topic = self.index.channels[channel_id].topic
                if (topics is None or topic in topics) and read[channel_id] < count:
                    damage.add(f"{self.path}: {read[channel_id]} of {count} messages of {topic} could be read")

    def _messages(self, damage: Damage, topics: frozenset[str] | None) -> Iterator[LogMessage]:
        # The index's copies serve where the chunk that first described a channel is damaged.
        known = self.index.definitions.copy() if self.index else Definitions()

        def take(opcode: int, body: bytes | memoryview, where: str) -> LogMessage | None:
            """Learn what a record says; the message in it, if it is a wanted one."""
            if opcode == Opcode.MESSAGE:
                if len(body) < _MESSAGE.size:
                    raise BrokenRecord("a message shorter than its header")
                channel_id, _, log_time_ns, _ = _MESSAGE.unpack_from(body)
                channel = known.channels.get(channel_id)
                if channel is None:
                    damage.add(
                        f"{where}: messages of channel {channel_id}, which is not described, are passed over"
                    )
                elif topics is None or channel.topic in topics:
                    # bytes, because a view would keep its whole chunk in memory
                    data = bytes(body[_MESSAGE.size :])
                    return LogMessage(channel, known.schemas.get(channel.schema_id), log_time_ns, data)
            elif opcode in (Opcode.CHANNEL, Opcode.SCHEMA):
                try:
                    known.learn(opcode, body)
                except TooMuch as error:  # not the end of its chunk
                    damage.add(f"{where}: passed over: {error}")
            return None

        with self._open() as stream:
            for record in self._records(stream, damage):
                where = f"{self.path} at byte {record.offset}"
                if record.opcode not in _READ or self._unwanted(record, topics):
                    continue
                whole = record.available == record.length
                try:
                    body = stream.read(record.available)
                    if record.opcode == Opcode.CHUNK:
                        for opcode, inner in split(memoryview(inflate(body, whole))):
                            if (message := take(opcode, inner, where)) is not None:
                                yield message
                    elif whole and (message := take(record.opcode, body, where)) is not None:
                        yield message
                except BrokenRecord as error:
                    if whole:  # else the cut has been noted
                        kind = "chunk" if record.opcode == Opcode.CHUNK else "record"
                        damage.add(f"{where}: a damaged {kind} of {record.length} bytes is passed over: {error}")

    def _unwanted(self, record: _Record, topics: frozenset[str] | None) -> bool:
        """Whether the index tells that a chunk holds nothing of these topics."""
        if topics is None or self.index is None or record.opcode != Opcode.CHUNK:
            return False
        listed = self.index.chunk_channels.get(record.offset)
        return listed is not None and not any(self.index.channels[i].topic in topics for i in listed)

    def _records(self, stream: IO[bytes], damage: Damage) -> Iterator[_Record]:
        """The records in order; `stream` stands at the body of the one yielded.

        A record never reaches into a chunk that the index lists: where one claims to, reading goes on there.
        """
        chunks = list(self.index.chunk_channels) if self.index else []
        at = len(MAGIC)
        ended = False
        while True:
            damage.bytes_read = self.size if ended else at
            number = bisect_right(chunks, at)
            next_chunk = chunks[number] if number < len(chunks) else None
            stream.seek(at)
            frame = stream.read(FRAME.size)
            left = (next_chunk or self.size) - at - FRAME.size
            opcode, length = FRAME.unpack(frame) if left >= 0 and len(frame) == FRAME.size else (0, 0)
            problem = ""
            if left < 0 and next_chunk is None:
                problem = "the recording was not closed"
            elif opcode == 0:
                problem = "no record stands there (zeros, or damage)"
            elif length > left:
                problem = f"the record there has {length} bytes, only {left} follow"
                # A chunk can be read as far as it goes; anything else claiming so much is of no use.
                if opcode == Opcode.CHUNK and left <= MAX_RECORD_BYTES:
                    yield _Record(at, opcode, length, left)
            elif length > MAX_RECORD_BYTES and opcode in _READ:
                damage.add(f"{self.path} at byte {at}: a record of {length / 2**20:.0f} MiB is passed over")
            elif opcode == Opcode.FOOTER and (ended or left - length == len(MAGIC)):
                damage.bytes_read = self.size
                return
            else:
                # What follows the data is the summary; nothing is lost by looking for messages in it.
                ended |= opcode == Opcode.DATA_END and next_chunk is None
                yield _Record(at, opcode, length, length)
            if not problem:
                at += FRAME.size + length
            elif next_chunk is not None:
                damage.add(f"{self.path} is damaged at byte {at}: {problem}; read on at byte {next_chunk}")
                at = next_chunk
            else:
                if not ended:
                    read = (
                        f"{at / 1e6:.2f} of {self.size / 1e6:.2f} MB ({100 * at / self.size:.0f} %) could be read"
                    )
                    damage.add(f"{self.path} is cut off or damaged at byte {at}: {problem}; {read}")
                return

    def attachments(self, damage: Damage, max_bytes: int = 2**20) -> Iterator[Attachment]:
        """The attachments of at most `max_bytes`, in file order."""
        if self.index is not None and self.index.attachment_count == 0:
            return
        with self._open() as stream:
            for record in self._records(stream, damage):
                if record.opcode == Opcode.ATTACHMENT and record.length <= max_bytes:
                    try:
                        yield parse(Attachment.read, stream.read(record.length))
                    except BrokenRecord as error:
                        damage.add(
                            f"{self.path} at byte {record.offset}: a damaged attachment is passed over: {error}"
                        )

    def header(self) -> Header | None:
        """The header record, None where it is damaged."""
        with self._open() as stream:
            record = next(self._records(stream, Damage()), None)
            if record is None or record.opcode != Opcode.HEADER or record.length > 2**16:
                return None
            try:
                return parse(Header.read, stream.read(record.length))
            except BrokenRecord:
                return None


def _index(stream: IO[bytes]) -> tuple[Index | None, str]:
    try:
        return read_index(stream), ""
    except BrokenRecord as error:
        return None, str(error)


def _other_format(start: bytes) -> str:
    if start.startswith(b"#ROSBAG"):
        return " but a ROS 1 bag: convert it with `mcap convert in.bag out.mcap`"
    if start.startswith(b"SQLite"):
        return " but a ROS 2 SQLite bag: convert it with `ros2 bag convert` to storage id mcap"
    if start.startswith((b"\x89PNG", b"\xff\xd8\xff")):
        return " but an image: import images into a log first"
    if start.startswith(b"RRF"):
        return " but a Rerun recording"
    if start.startswith(MAGIC[:5]):
        return " of version 0"
    return ""
