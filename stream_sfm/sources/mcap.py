"""MCAP files as a source: one file, or several that are one recording."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from mcap.records import Channel as McapChannel
from mcap.records import Schema

from ..mcap_file.damage import Damage
from ..mcap_file.log_file import LogFile
from .source import Attachment, Channel, Contents, Message


class McapSource:
    """The messages of MCAP files, one file after the other."""

    def __init__(self, path: str | Path, files: Sequence[LogFile]) -> None:
        """`path` names the recording; `files` are its parts in order of time."""
        self.path = Path(path)
        self._files = list(files)
        self.size_bytes = sum(file.size for file in files)

    def contents(self) -> Contents | None:
        """From the indexes, where every file has one."""
        contents = Contents()
        spans = []
        for file in self._files:
            if (index := file.index) is None:
                return None
            for channel in index.channels.values():
                count = index.counts.get(channel.id, 0) if index.counts else None
                contents.channels.append((_described(channel, index.schemas.get(channel.schema_id)), count))
            if any(index.counts.values()):
                spans.append((index.start_ns, index.end_ns))
        if spans:
            contents.start_ns, contents.end_ns = min(s for s, _ in spans), max(e for _, e in spans)
        return contents

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all), each file in its own order."""
        for file, own, before in self._readings(damage):
            channels = _Channels()
            for channel, schema, log_time_ns, data in file.messages(own, topics):
                damage.bytes_read = before + own.bytes_read
                yield Message(channels.described(channel, schema), log_time_ns, data)

    def attachments(self, damage: Damage) -> Iterator[Attachment]:
        """Yield the attachments of all files."""
        for file, own, _ in self._readings(damage):
            for attachment in file.attachments(own):
                yield Attachment(attachment.name, attachment.data)

    def _readings(self, damage: Damage) -> Iterator[tuple[LogFile, Damage, int]]:
        """Yield each file with a record of its own damage and the bytes read before; `damage` gets the sum."""
        before = 0
        for file in self._files:
            own = Damage(notes=damage.notes)  # one list, so that its limit is that of the whole reading
            try:
                yield file, own, before
            finally:
                damage.complete &= own.complete
                damage.bytes_read = before + own.bytes_read
            before += file.size

    def description(self) -> dict[str, Any]:
        """The header of the first file."""
        header = self._files[0].header()
        return {
            "format": "MCAP",
            "profile": header.profile if header else None,
            "library": header.library if header else None,
            "indexed": all(file.index is not None for file in self._files),
        }

    def drop_unverified_index(self) -> bool:
        """An index without a checksum may be what is wrong where a recording seems unusable."""
        dropped = False
        for file in self._files:
            if file.index is not None and not file.index.checksummed:
                file.index = None
                file.index_problem = "it carries no checksum, and by it the recording cannot be used"
                dropped = True
        return dropped


class _Channels:
    """One `Channel` for each channel of a file, as long as the file does not describe it anew."""

    def __init__(self) -> None:
        self._described: dict[int, tuple[McapChannel, Schema | None, Channel]] = {}

    def described(self, channel: McapChannel, schema: Schema | None) -> Channel:
        known = self._described.get(channel.id)
        if known is None or known[0] is not channel or known[1] is not schema:
            known = self._described[channel.id] = channel, schema, _described(channel, schema)
        return known[2]


def _described(channel: McapChannel, schema: Schema | None) -> Channel:
    if schema is None:
        return Channel(channel.topic, channel.message_encoding, "", "", b"")
    return Channel(channel.topic, channel.message_encoding, schema.name, schema.encoding, schema.data)
