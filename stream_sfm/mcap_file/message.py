"""Messages as they are stored, of MCAP and of every other container, with what describes their bytes; what is lost."""

from dataclasses import dataclass, field
from typing import NamedTuple

from ..record import record
from ..wording import LISTED


@record
class Channel:
    """What describes the bytes of a message: its topic, its encoding and its schema.

    Encodings have the names of the MCAP specification ("cdr" with "ros2msg", "protobuf" with "protobuf", …).
    `schema_name` is empty where there is no schema. Channels are compared by identity: a topic of several files, or
    of several publishers, has several. `metadata`: what a recorder says of the channel.
    """

    topic: str
    message_encoding: str
    schema_name: str
    schema_encoding: str
    definition: bytes
    metadata: tuple[tuple[str, str], ...] = ()


class Message(NamedTuple):
    """One message as stored; `log_time_ns` is the recorder's clock, `publish_time_ns` the sender's, if it is known."""

    channel: Channel
    log_time_ns: int
    data: bytes
    publish_time_ns: int | None = None
    sequence: int = 0


@dataclass(slots=True)
class Damage:
    """`complete` becomes false once anything was lost; `notes` say for people what and where."""

    complete: bool = True
    bytes_read: int = 0
    notes: list[str] = field(default_factory=list)

    def add(self, note: str) -> None:
        """Record that something was lost; a repeated note is kept once."""
        self.complete = False
        self.note(note)

    def note(self, note: str) -> None:
        """Record that something is wrong that has cost nothing."""
        if len(self.notes) < LISTED and note not in self.notes:
            self.notes.append(note)
