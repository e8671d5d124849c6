"""Stored messages of MCAP and every other container, their damage, and the protocol of a source."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

import msgspec
from mcap.records import Attachment

from ...inertial.samples import ImuCalibration
from ...record import record
from ...system.wording import LISTED


@record
class Channel:
    """The description of the bytes of a message: topic, encoding and schema, by their names in MCAP.

    `schema_name` is empty if there is no schema. Channels are compared by identity: a topic of several files, or
    of several publishers, has several. `metadata`: what a recorder says about the channel.
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


class Damage(msgspec.Struct):
    """What a reading has lost: `complete` becomes false with any loss; `notes` say in words what and where."""

    complete: bool = True
    bytes_read: int = 0
    notes: list[str] = msgspec.field(default_factory=list)

    def add(self, note: str) -> None:
        """Record that something was lost; a repeated note is kept once."""
        self.complete = False
        self.note(note)

    def note(self, note: str) -> None:
        """Record a problem that caused no loss."""
        if len(self.notes) < LISTED and note not in self.notes:
            self.notes.append(note)


class Contents(msgspec.Struct):
    """The content of an index: each channel with its number of messages (None: unknown), and the span of log times."""

    channels: Sequence[tuple[Channel, int | None]]
    start_ns: int = 0
    end_ns: int = 0


class Source(Protocol):
    """A recording on disk. Each reading starts from the beginning, so that readings do not disturb each other.

    `format`, `profile`, `library`: facts about the container, for display.
    """

    path: Path
    size_bytes: int
    format: str
    profile: str | None = None
    library: str | None = None
    imu: ImuCalibration | None = None  # of its inertial unit, if files beside the samples contain it
    left_out: int = 0  # pairs of a live camera that were dropped because they came too fast
    in_order: bool = False  # messages come in the order of their stamps: nothing is held back for sorting

    @property
    def indexed(self) -> bool:
        """Whether the content of the recording is known without reading it."""
        return True

    def contents(self) -> Contents | None:
        """Return the content of the recording if it is known without reading; None: it has to be read."""

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all), roughly in order of time; losses are added to `damage`."""

    def attachments(self, damage: Damage) -> Iterator[Attachment]:
        """Yield the files attached to the recording, of at most 1 MiB each."""
        return iter(())

    def waiting(self) -> int | None:
        """Number of pairs that a live camera has delivered and that wait to be read; None of a recording."""
        return None

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
    """Another source with some of its topics made again; what is not overridden is as it is there."""

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
