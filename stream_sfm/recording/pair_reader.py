"""The two camera topics of a log as pairs of undecoded images, with an account of what was read and lost."""

from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import LogError
from ..mcap_file.log_file import Damage, LogFile
from .images import check_encoding
from .messages import ImageMessage, MessageDecoder, UndecodableMessage
from .pairing import Pairer, PairingCounts


@dataclass(frozen=True, slots=True)
class StereoPair:
    """Two images of one moment as recorded, of one camera twice the same; the pair's stamp is the left one's."""

    left: ImageMessage
    right: ImageMessage

    @property
    def images(self) -> tuple[ImageMessage, ImageMessage]:
        """Left and right."""
        return self.left, self.right

    @property
    def stamp_ns(self) -> int:
        """Nanoseconds, of the left image."""
        return self.left.stamp_ns


@dataclass(slots=True)
class ReadStats:
    """What one reading met; final when its iterator has ended. Frames of one side count single images."""

    left_read: int = 0
    right_read: int = 0
    paired: int = 0
    paired_exactly: int = 0
    unpaired_left: int = 0
    unpaired_right: int = 0
    unpaired_within: int = 0  # of both sides, between two pairs
    dropped_backwards: int = 0  # stamp not after the one before it on the same side
    undecodable: int = 0  # messages, or pairs of which one image is damaged or of another size
    largest_offset_ns: int = 0  # between the stamps of a pair
    bytes_read: int = 0
    bytes_total: int = 0
    complete: bool = True  # false: something of the file could not be read
    warnings: list[str] = field(default_factory=list)


class PairReader:
    """Reads pairs from two topics of one file; each reading starts anew and renews `stats`.

    Where both topics are the same, every image is paired with itself, and so sorted and counted as others are.
    """

    def __init__(self, file: LogFile, left_topic: str, right_topic: str) -> None:
        self.file = file
        self.left_topic, self.right_topic = left_topic, right_topic
        self.stats = ReadStats(bytes_total=file.size)

    def pairs(self) -> Generator[StereoPair, None, None]:
        """All pairs in ascending order of stamps, not decoded; the bytes are those of the log.

        A log that is cut off or damaged gives what can be read; `stats` says what was lost. Raises LogError
        where the images are of a kind that is not read, or where nothing could be paired.
        """
        stats = self.stats = ReadStats(bytes_total=self.file.size)
        damage = Damage()
        decoder = MessageDecoder(self.file.path)
        pairer: Pairer[ImageMessage] = Pairer()
        topics = (self.left_topic, self.right_topic)
        unchecked = set(topics)
        problem = ""
        try:
            for message in self.file.messages(damage, frozenset(topics)):
                topic = message.channel.topic
                try:
                    image = decoder.image(message)
                except UndecodableMessage as error:
                    stats.undecodable += 1
                    problem = problem or str(error)
                    continue
                if topic in unchecked:
                    check_encoding(image, self.file.path)
                    unchecked.remove(topic)
                for side in (side for side in (0, 1) if topics[side] == topic):
                    for left, right in pairer.push(side, image.stamp_ns, image, len(image.data)):
                        self._count(stats, damage, pairer.counts)
                        yield StereoPair(left, right)
            for left, right in pairer.finish():
                self._count(stats, damage, pairer.counts)
                yield StereoPair(left, right)
        finally:
            self._count(stats, damage, pairer.counts)
            stats.complete = damage.complete
            stats.warnings += _warnings(stats, damage, problem, self.file.path)
        if stats.paired == 0:
            raise LogError(self._nothing_paired(stats, problem))

    @staticmethod
    def _count(stats: ReadStats, damage: Damage, counts: PairingCounts) -> None:
        stats.left_read, stats.right_read = counts.read
        stats.paired, stats.paired_exactly = counts.paired, counts.paired_exactly
        stats.unpaired_left, stats.unpaired_right = counts.unpaired
        stats.unpaired_within = counts.unpaired_within
        stats.dropped_backwards = sum(counts.backwards)
        stats.largest_offset_ns = counts.largest_offset_ns
        stats.bytes_read = damage.bytes_read

    def _nothing_paired(self, stats: ReadStats, problem: str) -> str:
        of = f"{self.left_topic} ({stats.left_read} images) and {self.right_topic} ({stats.right_read})"
        if not stats.left_read or not stats.right_read:
            cure = problem or "; ".join(stats.warnings) or "both cameras must have images"
        elif stats.dropped_backwards:
            cure = f"{stats.dropped_backwards} stamps do not increase: do the images carry stamps in their header?"
        else:
            cure = (
                "no two stamps lie within half a frame: are the cameras synchronised, or the topics written one "
                "after the other (then sort the file with `mcap sort`)?"
            )
        return f"{self.file.path}: no stereo pair in {of}: {cure}"


def _warnings(stats: ReadStats, damage: Damage, problem: str, path: Path) -> list[str]:
    notes = list(damage.notes)
    if not damage.complete:
        notes.append(
            f"{path} could be read in part only: {stats.paired} stereo frames from "
            f"{damage.bytes_read / 1e6:.2f} of {stats.bytes_total / 1e6:.2f} MB"
        )
    if stats.dropped_backwards:
        notes.append(f"{stats.dropped_backwards} images were dropped: their stamps repeat or go backwards")
    if stats.unpaired_within or stats.unpaired_left + stats.unpaired_right > 2:  # one or two at the ends are usual
        notes.append(
            f"{stats.unpaired_left} left and {stats.unpaired_right} right images have no partner within half a "
            "frame period"
        )
    if problem:
        notes.append(f"messages that could not be read, the first: {problem}")
    return notes
