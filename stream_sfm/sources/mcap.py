"""An MCAP file as a source."""

from collections.abc import Iterator
from pathlib import Path

from mcap.records import Channel as McapChannel
from mcap.records import Schema

from ..mcap_file.damage import Damage
from ..mcap_file.log_file import LogFile
from .source import Attachment, Channel, Contents, Message, Source


class McapSource(Source):
    """The messages of one MCAP file, in file order. Arguments and errors as of `LogFile`."""

    def __init__(self, path: str | Path, descriptor: int | None = None) -> None:
        self._file = LogFile(path, descriptor)
        self.path = self._file.path
        self.size_bytes = self._file.size
        header = self._file.header()
        self.format = "MCAP"
        self.profile, self.library = (header.profile, header.library) if header else (None, None)

    @property
    def indexed(self) -> bool:
        """See `Source`."""
        return self._file.index is not None

    def contents(self) -> Contents | None:
        """From the index, where there is one that can be trusted."""
        if (index := self._file.index) is None:
            return None
        contents = Contents([], index.start_ns, index.end_ns)
        for channel in index.channels.values():
            count = index.counts.get(channel.id, 0) if index.counts else None
            contents.channels.append((_described(channel, index.schemas.get(channel.schema_id)), count))
        return contents

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all)."""
        described: dict[int, tuple[McapChannel, Schema | None, Channel]] = {}
        for channel, schema, log_time_ns, data, *_ in self._file.messages(damage, topics):
            known = described.get(channel.id)
            if known is None or known[0] is not channel or known[1] is not schema:  # a file may redefine a channel
                known = described[channel.id] = channel, schema, _described(channel, schema)
            yield Message(known[2], log_time_ns, data)

    def attachments(self, damage: Damage) -> Iterator[Attachment]:
        """Yield the attachments, in file order."""
        for attachment in self._file.attachments(damage):
            yield Attachment(attachment.name, attachment.data)

    def drop_unverified_index(self) -> bool:
        """See `Source`: such an index may be what is wrong where a recording seems unusable."""
        if self._file.index is None or self._file.index.checksummed:
            return False
        self._file.index = None
        self._file.index_problem = "it carries no checksum, and by it the log cannot be used"
        return True


def _described(channel: McapChannel, schema: Schema | None) -> Channel:
    if schema is None:
        return Channel(channel.topic, channel.message_encoding, "", "", b"")
    return Channel(channel.topic, channel.message_encoding, schema.name, schema.encoding, schema.data)
