"""Camera topics with H.264 or H.265, read as topics with raw images: their frames depend on each other.

They are therefore decoded in order, whichever of them are wanted, so that a later `--start` gets the same images.
"""

import heapq
from collections.abc import Generator, Iterator
from dataclasses import replace
from itertools import islice

from ...errors import LogError
from ...record import changed
from ...system.inputs import LIMITS
from ...system.wording import counted
from ..mcap_file.message import Damage, Derived, Message, Source
from ..sources.sides import is_camera
from ..sources.video_stream import VideoStream, codec_of
from .messages import ImageMessage, MessageDecoder, UndecodableMessage, decoded
from .survey import Survey, Topic


def with_videos(source: Source, survey: Survey) -> tuple[Source, Survey]:
    """Return the recording with its video topics as topics of images; unchanged if it has none.

    Videos also come as ROS's CompressedImage, as their first message shows. Other codecs than H.264 and H.265 stay
    video. Among very many topics only the first are examined, as each costs a reading.
    """
    asked = (t for t in survey.topics.values() if t.count != 0 and _may_be_video(t) and is_camera(t.name))
    codecs = {topic.name: _codec(source, topic) for topic in islice(asked, LIMITS.compressed)}
    found = {name: codec for name, codec in codecs.items() if codec is not None}
    if not found:
        return source, survey
    topics = {name: changed(t, kind="image") if name in found else t for name, t in survey.topics.items()}
    return _Decoded(source, found), changed(survey, topics=topics)


def _may_be_video(topic: Topic) -> bool:
    return topic.kind == "video" or (topic.kind == "image" and topic.schema.endswith("CompressedImage"))


def _codec(source: Source, topic: Topic) -> str | None:
    """Return the codec of such a topic by its first message: h264 or h265; None if it is neither or unreadable."""
    try:
        first = next(decoded(source, [topic.name], MessageDecoder.image), None)
    except LogError:
        return None  # a user of the topic gets an error
    return codec_of(first.encoding) if first is not None and first.compressed else None


class _Decoded(Derived):
    """A source that delivers its videos, topic -> codec, as raw images."""

    def __init__(self, source: Source, videos: dict[str, str]) -> None:
        super().__init__(source)
        self._videos = videos

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all); each video is read separately, as its decoder asks for frames."""
        parts = [damage, *(Damage(notes=damage.notes) for _ in self._videos)]  # one list of notes
        wanted = frozenset(self._videos if topics is None else self._videos.keys() & topics)
        readings = [self._pictures(name, part) for name, part in zip(sorted(wanted), parts[1:], strict=False)]
        if topics is None or topics - wanted:
            others = None if topics is None else topics - wanted
            messages = self.source.messages(damage, others)
            readings.append(m for m in messages if m.channel.topic not in self._videos)
        try:
            yield from heapq.merge(*readings, key=lambda message: message.log_time_ns)
        finally:
            for reading in readings:
                reading.close()
            damage.complete = all(part.complete for part in parts)
            damage.bytes_read = max(part.bytes_read for part in parts)

    def _pictures(self, topic: str, damage: Damage) -> Generator[Message]:
        from ..sources.profile import raw_channel, raw_message

        channel, where = raw_channel(topic), f"{self.path}: topic {topic}"
        stream = VideoStream(self._videos[topic], self._frames(topic, damage))
        last_sent, newest_ns = -1, 0  # of the images shown so far
        try:
            for (image, log_time_ns, sent), picture in stream.pictures():
                if sent < last_sent and image.stamp_ns < newest_ns:
                    raise LogError(
                        f"{where}: the images are shown in another order than they are sent (B frames), but their "
                        "stamps have the order of sending, so they belong to other images: record without B frames"
                    )
                if sent > last_sent:
                    last_sent, newest_ns = sent, image.stamp_ns
                made = raw_message(channel, image.frame_id, image.stamp_ns, picture)
                yield made._replace(log_time_ns=log_time_ns)
        finally:
            if stream.skipped:
                skipped = f"{counted(stream.skipped, 'frame')} of video before the first key frame"
                damage.note(f"{where}: {skipped} cannot be decoded")
            if stream.lost:
                damage.add(f"{where}: {counted(stream.lost, 'frame')} of video could not be decoded")
            if stream.incomplete:
                left_out = f"{counted(stream.incomplete, 'frame')} of video left out"
                damage.add(f"{where}: {left_out}: they depend on frames that are missing")

    def _frames(self, topic: str, damage: Damage) -> Iterator[tuple[tuple[ImageMessage, int, int], bytes]]:
        """Yield each frame without its bytes, with its log time and its number as sent, and then its bytes."""
        decoder = MessageDecoder(self.path)
        for sent, message in enumerate(self.source.messages(damage, frozenset([topic]))):
            try:
                image = decoder.image(message)
            except UndecodableMessage as error:
                damage.add(f"{self.path}: a frame of video was skipped: {error}")
                continue
            yield (replace(image, data=b""), message.log_time_ns, sent), image.data
