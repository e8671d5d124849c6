"""Writes logs: messages of any source into an MCAP file."""

from pathlib import Path
from typing import IO, cast

from ... import __version__
from ...system.files import PartFile
from .library import CompressionType, Writer
from .message import Channel, Message


class MessageWriter:
    """Writes messages unchanged; a context manager. Attachments and metadata go to its `writer` of the mcap library.

    The file appears under its name when it is finished; a failed run leaves no file, unless `keep` is set.
    `compressed`: by zstd, for messages that are not compressed themselves. Raises OutputError.
    """

    def __init__(self, path: str | Path, *, keep: bool = False, compressed: bool = False, profile: str = "") -> None:
        self.path = Path(path)
        self._channels: dict[Channel | tuple[object, ...], int] = {}  # by identity, and by content
        self._schemas: dict[tuple[str, str, bytes], int] = {("", "", b""): 0}
        self._file = PartFile(path, keep=keep)
        # Images are usually compressed already; then only the index of the chunks is useful.
        compression = CompressionType.ZSTD if compressed else CompressionType.NONE
        self.writer = Writer(cast("IO[bytes]", self._file), compression=compression)
        self.writer.start(profile, f"stream_sfm {__version__}")

    def write(self, message: Message) -> None:
        channel, log_time_ns, data, publish_time_ns, sequence = message
        if channel not in self._channels:
            self._channels[channel] = self._register(channel)
        published_ns = log_time_ns if publish_time_ns is None else publish_time_ns
        self.writer.add_message(self._channels[channel], log_time_ns, data, published_ns, sequence)

    def _register(self, channel: Channel) -> int:
        schema = (channel.schema_name, channel.schema_encoding, channel.definition)
        if schema not in self._schemas:
            self._schemas[schema] = self.writer.register_schema(*schema)
        content = channel.topic, channel.message_encoding, self._schemas[schema], channel.metadata
        if content not in self._channels:
            self._channels[content] = self.writer.register_channel(*content[:3], dict(channel.metadata))
        return self._channels[content]

    def __enter__(self) -> "MessageWriter":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.close()
        else:
            self._file.discard()

    def close(self) -> None:
        """Finish the file and give it its name."""
        with self._file:
            self.writer.finish()
