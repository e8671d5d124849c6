"""Bags whose messages were each compressed with zstd by `ros2 bag record --compression-mode message`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import zstandard

from ..mcap_file.damage import Damage
from ..mcap_file.records import MAX_RECORD_BYTES
from .source import Attachment, Contents, Message, Source


class ZstdMessages:
    """Another source with its messages decompressed."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self.path: Path = source.path
        self.size_bytes = source.size_bytes

    def contents(self) -> Contents | None:
        """As the source's own."""
        return self._source.contents()

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all); those that cannot be decompressed are added to `damage`."""
        decompressor = zstandard.ZstdDecompressor()
        for message in self._source.messages(damage, topics):
            try:
                with decompressor.stream_reader(message.data) as reader:
                    data = reader.read(MAX_RECORD_BYTES + 1)
            except zstandard.ZstdError as error:
                damage.add(f"{self.path}: a damaged message of {message.channel.topic} was skipped: {error}")
                continue
            if len(data) > MAX_RECORD_BYTES:
                damage.add(f"{self.path}: a message of {message.channel.topic} over 128 MiB was skipped")
                continue
            yield message._replace(data=data)

    def attachments(self, damage: Damage) -> Iterator[Attachment]:
        """As the source's own."""
        return self._source.attachments(damage)

    def description(self) -> dict[str, Any]:
        """As the source's own."""
        return self._source.description()

    def drop_unverified_index(self) -> bool:
        """As the source's own."""
        return self._source.drop_unverified_index()
