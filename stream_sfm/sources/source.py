"""The protocol of a source: messages by topic, attachments, and what is known without reading."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from mcap.records import Attachment

from ..mcap_file.message import Channel, Damage, Message

BAG_METADATA = "metadata.yaml"  # by which the folder of a ROS 2 bag is known


@dataclass(slots=True)
class Contents:
    """What an index contains: each channel with its number of messages (None: unknown), and the span of log times."""

    channels: Sequence[tuple[Channel, int | None]]
    start_ns: int = 0
    end_ns: int = 0


class Source(Protocol):
    """A recording as it lies on disk. Each reading starts anew, so that readings do not disturb each other.

    `format`, `profile`, `library`: facts about the container, for people. Kinds that have no attachments and no index
    beside their content inherit the defaults.
    """

    path: Path
    size_bytes: int
    format: str
    profile: str | None = None
    library: str | None = None
    in_order: bool = False  # messages come as they were stamped: nothing is held back to be sorted

    @property
    def indexed(self) -> bool:
        """Whether what the recording holds is known without reading it."""
        return True

    def contents(self) -> Contents | None:
        """What the recording holds, where that is known without reading it; None: it has to be read."""
        ...

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all), about in order of time; what is lost is added to `damage`."""
        ...

    def attachments(self, damage: Damage) -> Iterator[Attachment]:
        """Yield the files attached to the recording, of at most 1 MiB each."""
        return iter(())

    def close(self) -> None:
        """Give back what is open: a camera, and what it is recorded in."""
        return None

    def drop_unverified_index(self) -> bool:
        """Read without an index that carries no checksum from now on; False where there was none in use."""
        return False


def natural_order(name: str) -> list[tuple[int, str]]:
    """The key that sorts bag_2 before bag_10."""
    return [(int(t), "") if t.isdecimal() else (-1, t) for t in re.split(r"(\d+)", name) if t]
