"""One MCAP file, read in file order: one path for intact, unindexed, damaged and cut-off files.

Problems are collected in `Damage`. Messages before and after the damage are delivered: `walk.py` finds the intact
records, with or without the index.
"""

import os
import weakref
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import IO, Any

from mcap.opcode import Opcode
from mcap.records import Attachment, Header, Metadata

from ...errors import LogError
from ...system.deflate import zlib
from ...system.inputs import LIMITS, open_regular, reading
from .chunks import Allowance, decompress_chunk
from .definitions import Definitions
from .index import read_index
from .message import Contents, Damage, Message, Source
from .records import MAGIC, BrokenRecord, RecordTooLarge, ends_with_magic, parse_record, split_records
from .walk import MESSAGE_HEAD, READ, Record, Walk


class LogFile(Source):
    """One MCAP file, opened again for every reading, so that readings do not disturb each other.

    `index`: None if the file has no trustworthy one, as `damage` says. `copy`: the place of the content, if not
    `path`; `release` is called when this object ends. Raises LogError if it cannot be opened, is empty or is not MCAP.
    """

    format = "MCAP"

    def __init__(self, path: str | Path, copy: str | None = None, release: Callable[[], object] | None = None) -> None:
        self.path = Path(path)
        self._content = copy or self.path
        if release is not None:
            weakref.finalize(self, release)
        self.damage = Damage()  # of its start and its index
        with reading(self.path), self._open() as stream:
            self.size_bytes = os.fstat(stream.fileno()).st_size
            start = stream.read(len(MAGIC))
            if self.size_bytes == 0:
                raise LogError(f"{self.path} is empty (0 bytes): nothing was recorded")
            if start != MAGIC:
                if not ends_with_magic(stream):
                    version = " of this version" if start.startswith(MAGIC[:5]) else ""
                    raise LogError(f"{self.path} is not an MCAP file{version}; its first bytes are {start!r}")
                self.damage.note("its first bytes are not those of an MCAP file, its last ones are")
            try:
                self.index = read_index(stream, self.damage)
            except BrokenRecord as error:
                self.index = None
                self.damage.note(f"its index is not used: {error}")
        found = self._records(Header, Opcode.HEADER, Damage(), LIMITS.header_bytes, first_only=True)
        header = next((header for header, *_ in found), None)  # None if it is damaged
        self.profile, self.library = (header.profile, header.library) if header else (None, None)

    def _open(self) -> IO[bytes]:
        with reading(self.path):
            return open_regular(self._content, 1 << 18)

    @property
    def indexed(self) -> bool:
        return self.index is not None

    def contents(self) -> Contents | None:
        """Return the contents from the index, if that can be trusted."""
        if (index := self.index) is None:
            return None
        known = index.definitions
        channels = [(known.channel(n), index.counts.get(n, 0) if index.counts else None) for n in known.channels]
        return Contents(channels, index.start_ns, index.end_ns)

    def drop_unverified_index(self) -> bool:
        """Drop such an index, as `Source` says: it may be the reason why a recording seems unusable."""
        if self.index is None or self.index.checksummed:
            return False
        self.index = None
        self.damage.note("its index is not used: it carries no checksum, and by it the log cannot be used")
        return True

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all) in file order; unreadable parts are added to `damage`.

        With `topics`, chunks in which the index lists none of them are not even opened.
        """
        damage.complete &= self.damage.complete
        for note in self.damage.notes:
            damage.note(f"{self.path}: {note}")
        # The definitions in the index replace those in a damaged chunk that first described a channel.
        definitions = self.index.definitions.copy() if self.index else Definitions()
        parser = _Parser(definitions, topics, damage, lambda: self._definitions_anywhere)
        allowance, trusted = Allowance(), self.index is not None and self.index.checksummed
        try:
            with self._open() as stream:
                walk = Walk(self.path, stream, self.size_bytes, damage, parser.knows_channel)
                for record in walk:
                    if record.opcode not in READ or self._can_skip(record, topics):
                        continue
                    where = f"{self.path} at byte {record.offset}"
                    try:
                        body = walk.body(record)
                        # A chunk has a checksum. Definitions elsewhere that contradict earlier ones are damaged
                        # themselves.
                        parser.may_redefine = record.opcode == Opcode.CHUNK or (damage.complete and not trusted)
                        for opcode, inner in _records_in(record, body, allowance):
                            if (message := parser.parse(opcode, inner, where)) is not None:
                                yield message
                    except BrokenRecord as error:
                        if record.whole:  # otherwise the cut has been noted
                            kind = "chunk" if record.opcode == Opcode.CHUNK else "record"
                            damage.add(f"{where}: a damaged {kind} of {record.length} bytes was skipped: {error}")
                            walk.reject(record)
        except OSError as error:
            damage.add(self._reading_failed(damage, error))
        if damage.complete and self.index is not None:
            for number, count in self.index.counts.items():
                topic, read = self.index.definitions.channels[number].topic, parser.read[number]
                if (topics is None or topic in topics) and read < count:
                    damage.add(f"{self.path}: {read} of {count} messages of {topic} could be read")

    @cached_property
    def _definitions_anywhere(self) -> Definitions:
        """Return the schemas and channels in the whole file, the first of each number, even in damaged chunks."""
        found, allowance = Definitions(), Allowance()
        with self._open() as stream:
            walk = Walk(self.path, stream, self.size_bytes, Damage(), lambda _: False)
            for record in walk:
                if record.opcode in (Opcode.CHUNK, Opcode.SCHEMA, Opcode.CHANNEL):
                    body = walk.body(record)
                    if not _collect(found, record, body, allowance):
                        walk.reject(record)
        return found

    def _can_skip(self, record: Record, topics: frozenset[str] | None) -> bool:
        """Whether the index shows that a chunk holds nothing of these topics."""
        if topics is None or self.index is None or record.opcode != Opcode.CHUNK:
            return False
        listed = self.index.chunk_channels.get(record.offset)
        return listed is not None and not any(self.index.definitions.channels[i].topic in topics for i in listed)

    def attachments(self, damage: Damage, max_bytes: int = LIMITS.small_bytes) -> Iterator[Attachment]:
        """Yield the attachments of at most `max_bytes`, in file order."""
        if self.index is not None and self.index.attachment_count == 0:
            return
        for attachment, body, where in self._records(Attachment, Opcode.ATTACHMENT, damage, max_bytes):
            crc = int.from_bytes(body[-4:], "little")
            if crc and crc != zlib.crc32(memoryview(body)[:-4]):  # some old writers compute it differently
                damage.note(f"{where}: the checksum of attachment {attachment.name!r} does not match its content")
            yield attachment

    def metadata(self, damage: Damage) -> Iterator[Metadata]:
        """Yield the metadata records of at most 1 MiB, in file order."""
        for record, *_ in self._records(Metadata, Opcode.METADATA, damage, LIMITS.small_bytes):
            yield record

    def _records(
        self, kind: Any, opcode: Opcode, damage: Damage, max_bytes: int, first_only: bool = False
    ) -> Iterator[tuple[Any, bytes, str]]:
        """Yield the records of one kind, each with its body and its place; `first_only`: examine one record."""
        try:
            with self._open() as stream:
                walk = Walk(self.path, stream, self.size_bytes, damage, lambda _: False)
                for record in walk:
                    if record.opcode == opcode and record.length <= max_bytes:
                        body, where = walk.body(record), f"{self.path} at byte {record.offset}"
                        try:
                            yield parse_record(kind.read, body), body, where
                        except BrokenRecord as error:
                            damage.add(f"{where}: damaged {opcode.name.lower()} was skipped: {error}")
                    if first_only:
                        return
        except OSError as error:
            damage.add(self._reading_failed(damage, error))

    def _reading_failed(self, damage: Damage, error: OSError) -> str:
        """Describe a failing disk, a lost network share, or a file that became shorter."""
        return f"{self.path}: reading failed after byte {damage.bytes_read}: {error.strerror}"


class _Parser:
    """Turns the records of one reading into messages of the wanted topics, and collects schemas and channels."""

    def __init__(
        self,
        definitions: Definitions,
        topics: frozenset[str] | None,
        damage: Damage,
        find_definitions: Callable[[], Definitions],
    ) -> None:
        self.may_redefine = True
        self.read: Counter[int] = Counter()  # messages of the wanted topics, by the number of their channel
        self._definitions, self._topics, self._damage = definitions, topics, damage
        self._find_definitions: Callable[[], Definitions] | None = find_definitions  # None: already called

    def parse(self, opcode: int, body: bytes | memoryview, where: str) -> Message | None:
        """Return the message in a record, if it is of a wanted topic. Raises BrokenRecord."""
        if opcode == Opcode.MESSAGE:
            return self._message(body, where)
        if opcode in (Opcode.CHANNEL, Opcode.SCHEMA):
            try:
                self._definitions.add(opcode, body, self.may_redefine)
            except RecordTooLarge as error:  # the rest of its chunk can still be read
                self._damage.add(f"{where}: skipped: {error}")
        return None

    def knows_channel(self, channel_id: int) -> bool:
        """Whether a channel is described, before its messages or, if that is damaged, anywhere in the file."""
        if channel_id not in self._definitions.channels and self._find_definitions is not None:
            find, self._find_definitions = self._find_definitions, None
            self._definitions.add_missing(find())
        return channel_id in self._definitions.channels

    def _message(self, body: bytes | memoryview, where: str) -> Message | None:
        if len(body) < MESSAGE_HEAD.size:
            raise BrokenRecord("a message shorter than its header")
        number, sequence, log_time_ns, publish_time_ns = MESSAGE_HEAD.unpack_from(body)
        if not self.knows_channel(number):
            self._damage.add(f"{where}: messages of channel {number}, which is not described, were skipped")
            return None
        channel = self._definitions.channel(number)
        if self._topics is not None and channel.topic not in self._topics:
            return None
        self.read[number] += 1
        data = bytes(body[MESSAGE_HEAD.size :])  # a copy, as a view would keep its whole chunk in memory
        return Message(channel, log_time_ns, data, publish_time_ns, sequence)


def _records_in(
    record: Record, body: bytes, allowance: Allowance, verify: bool = True
) -> Iterator[tuple[int, bytes | memoryview]]:
    """Return the records in a chunk, or the one record that is not a chunk. May raise BrokenRecord at any record."""
    if record.opcode == Opcode.CHUNK:
        records = decompress_chunk(body, record.whole, allowance, verify)
        return split_records(memoryview(records), allowance.take_record)
    return iter([(record.opcode, body)] if record.whole else [])


def _collect(found: Definitions, record: Record, body: bytes, allowance: Allowance) -> bool:
    """Add the definitions with unknown numbers in a record; return whether the record is intact."""
    for part in (record, record._replace(available=0)):  # in a damaged chunk, the part before the damage
        new = Definitions()
        try:
            for opcode, inner in _records_in(part, body, allowance, verify=part is record):
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    new.add(opcode, inner)
            return part is record
        except BrokenRecord:
            continue
        finally:
            found.add_missing(new)
    return False
