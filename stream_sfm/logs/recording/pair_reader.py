"""The two camera topics of a log as pairs of undecoded images, with counts of what was read and lost."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from itertools import chain

from ...camera.rig import MonoRig, StereoRig
from ...errors import LogError
from ...record import changed, record
from ..mcap_file.message import Damage, Message, Source
from .images import check_encoding
from .messages import CalibrationMessage, ImageMessage, MessageDecoder, UndecodableMessage
from .pairing import Pairer

_MOST_REASONS = 3  # every unusable image may give one, and all say the same


@record
class StereoPair:
    """Two images of one moment as recorded, not decoded; with one camera, the same image twice.

    `rig`: the rig of the cameras then, if a `StereoLog` has asked for frames.
    """

    left: ImageMessage
    right: ImageMessage
    rig: StereoRig | MonoRig | None = None

    @property
    def images(self) -> tuple[ImageMessage, ImageMessage]:
        """Left and right."""
        return self.left, self.right

    @property
    def stamp_ns(self) -> int:
        """The stamp of the left image, nanoseconds, which is that of the pair."""
        return self.left.stamp_ns


@dataclass(slots=True)
class ReadStats:
    """Statistics of one reading; final when its iterator has ended. `left_*` and `right_*` count single images."""

    left_read: int = 0
    right_read: int = 0
    paired: int = 0
    paired_exactly: int = 0
    unpaired_left: int = 0
    unpaired_right: int = 0
    unpaired_within: int = 0  # of both sides, between two pairs
    dropped_backwards: int = 0  # images whose stamps repeat, go backwards, or are far from their neighbours
    undecodable: int = 0  # messages, or pairs with an image that is damaged or of another size
    largest_offset_ns: int = 0  # largest difference of the stamps of a pair
    bytes_read: int = 0
    bytes_total: int = 0
    complete: bool = True  # false: part of the file was not read
    warnings: list[str] = field(default_factory=list)


class PairReader:
    """Reads the pairs on two topics of a source, once: iterate `pairs`.

    If both topics are the same, every image is paired with itself. `calibrations`: messages of the cameras, valid
    at the first image. Each image gets the calibration that is valid then.
    """

    def __init__(
        self, source: Source, left_topic: str, right_topic: str, calibrations: Sequence[CalibrationMessage] = ()
    ) -> None:
        self._source, self._topics = source, (left_topic, right_topic)
        self._in_force = {message.topic: message for message in calibrations}
        self._calibrated_by = {image: sent.topic for image, sent in zip(self._topics, calibrations, strict=False)}
        self._change, self._changes = "", 0  # the first change of the calibration, and their number
        self._heard: dict[str, bytes] = {}  # the latest calibrations, without stamps
        self._decoder = MessageDecoder(source.path)
        self._damage = Damage()
        self._pairer: Pairer[ImageMessage] = Pairer(source.in_order)
        self._began_ns: int | None = None  # the time at which the first left image was recorded
        self._last_ns: int | None = None  # the stamp of the latest pair
        self._unchecked = {left_topic, right_topic}  # topics whose encoding is not yet checked
        self._by_log_time: bool | None = None  # whether the stamps are the log times; None: not known
        self._first: list[tuple[ImageMessage, int]] = []  # images that wait for this, and log times
        self._problem = ""  # that of the first message that could not be decoded
        self.stats = ReadStats(bytes_total=source.size_bytes)

    def pairs(self) -> Generator[StereoPair, None, None]:
        """Yield all pairs, not decoded, in ascending order of stamps, unless the clock of both cameras was set back.

        From a log that is cut off or damaged, all readable pairs come; at the end, `stats` says what was lost. Raises
        LogError if the images are of an unsupported kind, or if nothing could be paired.
        """
        try:
            messages = self._source.messages(self._damage, frozenset((*self._topics, *self._in_force)))
            for message in chain(messages, (None,)):
                for image in self._stamped(message):
                    for side in [side for side in (0, 1) if self._topics[side] == image.topic]:
                        yield from map(self._pair, self._pairer.push(side, image.stamp_ns, image, len(image.data)))
            yield from map(self._pair, self._pairer.finish())
        finally:
            self._finish()
        if self.stats.paired == 0:
            raise LogError(self._nothing_paired())

    def _nothing_paired(self) -> str:
        stats, (left, right) = self.stats, self._topics
        if not stats.left_read or not stats.right_read:
            remedy = self._problem or "; ".join(stats.warnings[:_MOST_REASONS]) or "both cameras must have images"
        elif stats.dropped_backwards:
            remedy = f"{stats.dropped_backwards} stamps do not increase: do headers of images carry stamps?"
        else:
            remedy = (
                "no two stamps lie within half a frame: are the cameras synchronised, or the topics written one "
                "after the other (then sort the file with `mcap sort`)?"
            )
        topics = f"{left} ({stats.left_read} images) and {right} ({stats.right_read})"
        return f"{self._source.path}: no stereo pair in {topics}: {remedy}"

    def _pair(self, images: tuple[ImageMessage, ImageMessage]) -> StereoPair:
        pair = StereoPair(*images)
        if self._last_ns is not None and pair.stamp_ns <= self._last_ns:
            back_s = (self._last_ns - pair.stamp_ns) / 1e9
            self._damage.note(f"{self._source.path}: the clock of both cameras was set back by {back_s:.3f} s")
        self._last_ns = pair.stamp_ns
        return pair

    def _image(self, message: Message) -> ImageMessage | None:
        """Return the image in a message; None for a calibration, which is taken in, and for undecodable messages."""
        if message.channel.topic in self._in_force:
            if self._began_ns is not None:
                self._hear(message)
            return None
        try:
            image = self._decoder.image(message)
        except UndecodableMessage as error:
            self.stats.undecodable += 1
            self._problem = self._problem or str(error)
            return None
        if image.topic in self._unchecked:
            check_encoding(image, self._source.path)
            self._unchecked.remove(image.topic)
        if self._began_ns is None and image.topic == self._topics[0]:
            self._began_ns = message.log_time_ns
        calibration = self._in_force.get(self._calibrated_by.get(image.topic, ""))
        return changed(image, calibration=calibration)

    def _hear(self, message: Message) -> None:
        """Take a calibration sent between images; if it differs, it is valid from here on.

        Most cameras send one with every image: equal bytes of ROS need not be decoded again.
        """
        behind_stamp = 12  # bytes of ROS, before the frame; they differ from one message to the next
        content, topic = message.data[behind_stamp:], message.channel.topic
        if message.channel.message_encoding in ("cdr", "ros1") and self._heard.get(topic) == content:
            return
        self._heard[topic] = content
        try:
            sent = self._decoder.calibration(message)
        except UndecodableMessage:
            return
        known = self._in_force[sent.topic]
        if changes := known.changes(sent) if sent.frame_id == known.frame_id else []:
            self._in_force[sent.topic] = sent
            self._changes += 1
            after_s = (message.log_time_ns - (self._began_ns or 0)) / 1e9
            self._change = self._change or (
                f"{self._source.path}: {after_s:.2f} s after the first image the calibration on topic {sent.topic} "
                f"changes ({', '.join(changes)})"
            )

    def _stamped(self, message: Message | None) -> list[ImageMessage]:
        """Return the images whose stamps are known with the next message, which is None after the last one.

        Stamps are replaced by log times if a driver leaves all of them at zero. Two zeros on one side decide
        this, because a single one may be the start of a simulated clock.
        """
        if message is not None:
            if (image := self._image(message)) is None:
                return []
            self._first.append((image, message.log_time_ns))
            if self._by_log_time is None:
                zeros = [other.stamp_ns == 0 for other, _ in self._first if other.topic == image.topic]
                if len(zeros) < 2:
                    return []
                self._by_log_time = all(zeros)
                if self._by_log_time:
                    where = f"{self._source.path}: the images on {image.topic}"
                    self.stats.warnings.append(f"{where} have no stamps (all are zero): their recording times are used")
        known, self._first = self._first, []
        return [changed(image, stamp_ns=log_time_ns) if self._by_log_time else image for image, log_time_ns in known]

    def _finish(self) -> None:
        """Complete `stats`, wherever the reading ended."""
        stats, damage, counts, path = self.stats, self._damage, self._pairer.counts, self._source.path
        stats.left_read, stats.right_read = counts.read
        stats.paired, stats.paired_exactly = counts.paired, counts.paired_exactly
        stats.unpaired_left, stats.unpaired_right = counts.unpaired
        stats.unpaired_within, stats.largest_offset_ns = counts.unpaired_within, counts.largest_offset_ns
        stats.dropped_backwards = sum(counts.disordered)
        stats.bytes_read = damage.bytes_read
        unused = stats.dropped_backwards or stats.undecodable or counts.parted
        stats.complete = damage.complete and not unused
        stats.warnings += damage.notes
        if self._change:
            stats.warnings.append(self._change + (f"; {self._changes} such changes" if self._changes > 1 else ""))
        if not damage.complete:
            read = f"{damage.bytes_read / 1e6:.2f} of {stats.bytes_total / 1e6:.2f} MB"
            stats.warnings.append(f"{path} could be read in part only: {stats.paired} stereo frames from {read}")
        if stats.dropped_backwards:
            wrong = "their stamps repeat, go backwards, or are far from those of the images around them"
            stats.warnings.append(f"{stats.dropped_backwards} images were dropped: {wrong}")
        if counts.parted:
            why = "because the two clocks differ for a time: was one set? Record again with one clock for both"
            stats.warnings.append(f"{path}: {counts.parted} images of each camera have no partner, {why}")
        usual = 2  # images without a partner: recorders start and stop between the two images of a pair
        if stats.unpaired_within or stats.unpaired_left + stats.unpaired_right > usual:
            alone = f"{stats.unpaired_left} left and {stats.unpaired_right} right images"
            stats.warnings.append(f"{alone} have no partner within half a frame period")
        if self._problem:
            stats.warnings.append(f"messages that could not be read were skipped, the first: {self._problem}")
