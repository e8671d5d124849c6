"""Messages as they are stored, of MCAP and of every other container, what is lost, and the protocol of a source."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Protocol

from mcap.records import Attachment

from ..inertial.samples import ImuCalibration
from ..record import record
from ..wording import LISTED


@record
class Channel:
    """What describes the bytes of a message: its topic, its encoding and its schema, by the names of MCAP.

    `schema_name` is empty if there is no schema. Channels are compared by identity: a topic of several files, or
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


@dataclass(slots=True)
class Contents:
    """What an index contains: each channel with its number of messages (None: unknown), and the span of log times."""

    channels: Sequence[tuple[Channel, int | None]]
    start_ns: int = 0
    end_ns: int = 0


class Source(Protocol):
    """A recording as it lies on disk. Each reading starts anew, so that readings do not disturb each other.

    `format`, `profile`, `library`: facts about the container, for people.
    """

    path: Path
    size_bytes: int
    format: str
    profile: str | None = None
    library: str | None = None
    imu: ImuCalibration | None = None  # of its inertial unit, where files beside the samples say it
    left_out: int = 0  # pairs of a camera that came faster than they were taken
    in_order: bool = False  # messages come as they were stamped: nothing is held back to be sorted

    @property
    def indexed(self) -> bool:
        """Whether what the recording holds is known without reading it."""
        return True

    def contents(self) -> Contents | None:
        """What the recording holds, where that is known without reading it; None: it has to be read."""

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all), about in order of time; what is lost is added to `damage`."""

    def attachments(self, damage: Damage) -> Iterator[Attachment]:
        """Yield the files attached to the recording, of at most 1 MiB each."""
        return iter(())

    def age_s(self, stamp_ns: int) -> float | None:
        """Seconds since a camera has delivered the images of this stamp; None of a recording."""
        return None

    def close(self) -> None:
        """Give back what is open: a camera, and what it is recorded in."""
        return None

    def drop_unverified_index(self) -> bool:
        """Read without an index that carries no checksum from now on; False where there was none in use."""
        return False


class Derived(Source):
    """Another source with some of its topics made anew; what is not overridden is as it is there."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.path, self.size_bytes, self.in_order = source.path, source.size_bytes, source.in_order
        self.format, self.profile, self.library = source.format, source.profile, source.library

    @property
    def indexed(self) -> bool:
        return self.source.indexed

    def contents(self) -> Contents | None:
        """The contents of the source as it lies on disk."""
        return self.source.contents()

    def attachments(self, damage: Damage) -> Iterator[Attachment]:
        """See `Source`."""
        return self.source.attachments(damage)

    def close(self) -> None:
        """See `Source`."""
        self.source.close()
