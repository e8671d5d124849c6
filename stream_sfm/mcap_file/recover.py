"""Copies what can be read of a damaged MCAP file into a new one."""

import os
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, cast

from mcap.records import Channel, Schema
from mcap.writer import Writer

from .. import __version__
from ..errors import LogError, OutputError
from ..files import PartFile, make_folder
from ..outputs import refuse_overwriting
from .damage import Damage
from .log_file import LogFile, LogMessage
from .records import MAX_RECORD_BYTES

_CHUNK_BYTES = 4 * 2**20


@dataclass(frozen=True, slots=True)
class Recovered:
    """What was copied to `path`: messages by topic, attachments and metadata records.

    `complete`: nothing was lost, as far as the file tells; `warnings` say what is wrong with it, and where.
    """

    path: Path
    messages: dict[str, int]
    attachments: int = 0
    metadata: int = 0
    complete: bool = True
    warnings: list[str] = field(default_factory=list)


def recover(log: str | Path, out: str | Path, *, overwrite: bool = False) -> Recovered:
    """Copy every readable message, attachment and metadata record of an MCAP file to `out`, in the order of the file.

    The messages are not decoded: their bytes, times and sequence numbers, and the definitions of their channels, are
    those of the log. `out` appears when it is whole; its folder is made if need be. `overwrite`: a file that is there
    may be replaced, but not the log. Raises LogError where the log has no readable message, and OutputError.
    """
    out = Path(out)
    file = LogFile(log)
    if os.path.lexists(out) and not overwrite:
        raise OutputError(
            f"{out} exists already: choose another name, or allow it to be replaced", hint=("overwrite",)
        )
    refuse_overwriting([out], [file.path])
    damage, counts = Damage(), Counter[str]()
    with _writer(out, file) as writer:
        copy = _Copy(writer)
        for message in file.messages(damage):
            copy.add(message)
            counts[message.channel.topic] += 1
        if not counts:
            raise LogError("; ".join([f"{file.path} has no message that can be read", *damage.notes[:3]]))
        attachments = metadata = 0
        for attachment in file.attachments(damage, MAX_RECORD_BYTES):
            writer.add_attachment(
                attachment.create_time, attachment.log_time, attachment.name, attachment.media_type, attachment.data
            )
            attachments += 1
        for record in file.metadata(damage):
            writer.add_metadata(record.name, record.metadata)
            metadata += 1
    return Recovered(out, dict(sorted(counts.items())), attachments, metadata, damage.complete, damage.notes)


@contextmanager
def _writer(out: Path, file: LogFile) -> Iterator[Writer]:
    """A writer of `out`, which appears when the context ends without an error."""
    make_folder(out.parent)
    header = file.header()
    with PartFile(out, keep=False) as part:
        writer = Writer(cast("IO[bytes]", part), chunk_size=_CHUNK_BYTES)
        writer.start(header.profile if header else "", f"stream_sfm {__version__}")
        yield writer
        writer.finish()


class _Copy:
    """Adds messages to a file, and the definitions of their channels when they are first used."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._channels: dict[tuple[object, ...], int] = {}
        self._schemas: dict[tuple[str, str, bytes], int] = {}

    def add(self, message: LogMessage) -> None:
        """Append one message."""
        channel_id = self._channel_id(message.channel, message.schema)
        self._writer.add_message(
            channel_id, message.log_time_ns, message.data, message.publish_time_ns, message.sequence
        )

    def _channel_id(self, channel: Channel, schema: Schema | None) -> int:
        schema_id = 0
        if schema is not None:
            content = schema.name, schema.encoding, schema.data
            if content not in self._schemas:
                self._schemas[content] = self._writer.register_schema(*content)
            schema_id = self._schemas[content]
        key = channel.id, channel.topic, channel.message_encoding, schema_id, *sorted(channel.metadata.items())
        if key not in self._channels:
            self._channels[key] = self._writer.register_channel(
                channel.topic, channel.message_encoding, schema_id, channel.metadata
            )
        return self._channels[key]
