"""Recordings of stereo cameras that deliver both images in one, side by side or stacked: read as two topics."""

from collections.abc import Iterator

from ...camera.calibration.document import Where
from ...camera.rig import StereoRig
from ...errors import LogError
from ...record import changed
from ..mcap_file.message import Damage, Derived, Message, Source
from ..sources.devices import halves
from ..sources.profile import ProfileEncoder
from ..sources.sides import is_camera
from .images import UndecodableImage, check_encoding, decode_grey
from .messages import MessageDecoder, UndecodableMessage
from .rig import first_sizes
from .survey import Survey


def both_sides(
    source: Source, survey: Survey, calibration: Where | StereoRig | None
) -> tuple[Source, Survey, Where | StereoRig | None]:
    """Return the recording with two image topics if its only one holds both sides of a pair; else unchanged."""
    cameras = [t for t, count in survey.of_kind("image").items() if is_camera(t) and count != 0]
    if calibration is None or len(cameras) != 1 or not (sizes := first_sizes(source, cameras)):
        return source, survey, calibration
    width, height = size = sizes[cameras[0]]
    if not isinstance(calibration, StereoRig):
        half = (width // 2, height) if width > height else (width, height // 2)
        calibration = StereoRig.from_calibration(calibration, half)
    one = calibration.left.width, calibration.left.height
    if size not in ((2 * one[0], one[1]), (one[0], 2 * one[1])):
        return source, survey, calibration
    split = _BothSides(source, cameras[0], calibration)
    topic = survey.topics[cameras[0]]
    topics = {name: known for name, known in survey.topics.items() if name != topic.name}
    topics |= {channel.topic: changed(topic, name=channel.topic) for channel in ProfileEncoder(None).raw_images}
    return split, changed(survey, topics=topics), calibration


class _BothSides(Derived):
    """A source with its one image topic cut into two."""

    def __init__(self, source: Source, topic: str, rig: StereoRig) -> None:
        super().__init__(source)
        self._topic, self._rig = topic, rig

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all); images that cannot be decoded are skipped."""
        encoder, decoder = ProfileEncoder(None), MessageDecoder(self.path)
        wanted = topics
        if topics is not None and topics & {channel.topic for channel in encoder.raw_images}:
            wanted = topics | {self._topic}
        for message in self.source.messages(damage, wanted):
            if message.channel.topic != self._topic:
                yield message
                continue
            try:
                image = decoder.image(message)
                check_encoding(image, self.path)
                sides = halves(decode_grey(image), self._rig, image.topic)
            except (UndecodableMessage, UndecodableImage, LogError) as error:
                damage.add(f"{self.path}: an image was skipped: {error}")
                continue
            for side, pixels in enumerate(sides):
                made = encoder.raw_image(side, image.stamp_ns, pixels)
                if topics is None or made.channel.topic in topics:
                    yield made._replace(log_time_ns=message.log_time_ns)
