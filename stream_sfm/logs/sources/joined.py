"""Several files that form one recording: the splits of a bag, or files that were recorded at the same time."""

import heapq
import re
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path

import zstandard
from mcap.records import Attachment

from ...system.inputs import LIMITS
from ..mcap_file.message import Contents, Damage, Message, Source


class JoinedSource(Source):
    """The messages of several sources, merged by log time; each part is opened only when its time comes.

    `missing` says which parts could not be opened; `notes` are further remarks. `compressed`: each message is, by zstd.
    """

    def __init__(
        self,
        path: str | Path,
        parts: Sequence[Source],
        missing: Sequence[str] = (),
        notes: Sequence[str] = (),
        compressed: bool = False,
    ) -> None:
        self.path, self._compressed = Path(path), compressed
        self._missing, self._notes = list(missing), list(notes)
        self._parts = list(parts)
        self._contents: list[Contents] | None = None
        known = [contents for part in parts if (contents := part.contents()) is not None]
        if len(known) == len(parts):  # otherwise the given order has to do
            order = sorted(range(len(parts)), key=lambda n: known[n].start_ns)
            self._parts, self._contents = [parts[n] for n in order], [known[n] for n in order]
        self.size_bytes = sum(part.size_bytes for part in parts)
        first = self._parts[0]
        self.format, self.profile, self.library, self.files = first.format, first.profile, first.library, len(parts)

    @property
    def indexed(self) -> bool:
        return all(part.indexed for part in self._parts)

    def contents(self) -> Contents | None:
        """Return the sum over the parts, if every part knows its contents."""
        if self._contents is None:
            return None
        channels = [entry for contents in self._contents for entry in contents.channels]
        used = [contents for contents in self._contents if any(count != 0 for _, count in contents.channels)]
        start_ns = min((contents.start_ns for contents in used), default=0)
        return Contents(channels, start_ns, max((contents.end_ns for contents in used), default=0))

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all) of all parts; those that cannot be decompressed are left out."""
        for message in self._stored(damage, topics):
            data = _decompressed(message.data) if self._compressed else message.data
            if isinstance(data, bytes):
                yield message._replace(data=data)
            else:
                damage.add(f"{self.path}: a message of {message.channel.topic} was skipped: {data}")

    def _stored(self, damage: Damage, topics: frozenset[str] | None) -> Iterator[Message]:
        damage.notes += self._notes
        for note in self._missing:
            damage.add(note)
        own = [Damage(notes=damage.notes) for _ in self._parts]  # one list: its limit is that of the whole reading
        waiting, starts = deque(range(len(self._parts))), self._contents
        # log time, number of the part, message, the rest
        heads: list[tuple[int, int, Message, Iterator[Message]]] = []

        def advance(number: int, rest: Iterator[Message]) -> None:
            if (message := next(rest, None)) is not None:
                heapq.heappush(heads, (message.log_time_ns, number, message, rest))

        try:
            while waiting or heads:
                # parts with unknown start times follow each other
                while waiting and (not heads or (starts and starts[waiting[0]].start_ns <= heads[0][0])):
                    number = waiting.popleft()
                    advance(number, self._parts[number].messages(own[number], topics))
                if heads:
                    _, number, message, rest = heapq.heappop(heads)
                    damage.bytes_read = sum(d.bytes_read for d in own)
                    yield message
                    advance(number, rest)
        finally:
            damage.bytes_read = sum(d.bytes_read for d in own)
            damage.complete &= all(d.complete for d in own)

    def attachments(self, damage: Damage) -> Iterator[Attachment]:
        """Yield the attachments of all parts."""
        for part in self._parts:
            yield from part.attachments(damage)

    def drop_unverified_index(self) -> bool:
        """Let every part drop its index, as `Source` says."""
        dropped = any([part.drop_unverified_index() for part in self._parts])  # all of them, not up to the first
        if dropped:
            self._contents = None
        return dropped


def _decompressed(data: bytes) -> bytes | str:
    """Return the content of a message, or why it cannot be decompressed."""
    try:
        with zstandard.ZstdDecompressor().stream_reader(data) as reader:
            content: bytes = reader.read(LIMITS.record_bytes + 1)
    except zstandard.ZstdError as error:
        return f"{error}"
    return content if len(content) <= LIMITS.record_bytes else "it is larger than 128 MiB"


def natural_order(name: str) -> list[tuple[int, str]]:
    """Return a key that sorts bag_2 before bag_10."""
    return [(int(t), "") if t.isdecimal() else (-1, t) for t in re.split(r"(\d+)", name) if t]
