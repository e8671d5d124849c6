"""The rig that a log is read with: given by the user, attached to the log, or sent by its cameras, in this order.

An attachment precedes messages because somebody put it there on purpose, whereas drivers send CameraInfo of cameras
that were never calibrated. Where P gives no baseline, the transform between the frames of the two cameras does.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from ..camera.calibration.read import Where, named
from ..camera.rig import MonoRig, StereoRig
from ..errors import ConfigError
from ..mcap_file.damage import Damage
from ..sources.source import Source
from .images import image_size
from .messages import CalibrationMessage, MessageDecoder, UndecodableMessage
from .rig import calibration_error, camera_from_message, gives_baseline, rig_from_messages
from .survey import Survey, read_calibration_messages
from .topics import PairChoice, choose_calibration, is_rectified
from .transforms import fixed_transform

ATTACHMENT = "calibration.toml"
Rig = TypeVar("Rig", StereoRig, MonoRig)


@dataclass(frozen=True, slots=True)
class FoundRig(Generic[Rig]):
    """A rig and, for people, where it comes from (`origin`); `sent`: the messages that it was made of, if it was."""

    rig: Rig
    origin: str
    sent: tuple[CalibrationMessage, ...] = ()


def find_rig(
    source: Source, survey: Survey, choice: PairChoice, calibration: Where | StereoRig | None = None
) -> FoundRig[StereoRig]:
    """The rig of the two cameras; `calibration` as in `open_log`. Raises LogError; ConfigError for `calibration`."""
    if isinstance(calibration, StereoRig):
        return FoundRig(calibration, "given by the caller")
    if calibration is not None:
        rig = StereoRig.from_calibration(calibration, first_size(source, choice.left))
        return FoundRig(rig, named(calibration))
    attached = _attached(source, StereoRig.parse_calibration)
    return FoundRig(attached, f"attachment {ATTACHMENT}") if attached else _sent(source, survey, choice)


def find_camera(
    source: Source, survey: Survey, topic: str, calibration: Where | StereoRig | MonoRig | None = None
) -> FoundRig[MonoRig]:
    """The rig of one image topic, from the same places and with the same errors as `find_rig`."""
    if isinstance(calibration, StereoRig | MonoRig):
        return FoundRig(MonoRig(calibration.left), "given by the caller")
    if calibration is not None:
        return FoundRig(MonoRig.from_calibration(calibration, first_size(source, topic)), named(calibration))
    if rig := _attached(source, MonoRig.parse_calibration):
        return FoundRig(rig, f"attachment {ATTACHMENT}")
    sent_on = _calibration_topic(source, survey, topic, 0)
    message, _ = read_calibration_messages(source, (sent_on, sent_on), topic, MessageDecoder(source.path))
    rig = camera_from_message(source.path, message, is_rectified(topic))
    return FoundRig(rig, message.topic, (message,))


def first_size(source: Source, topic: str) -> tuple[int, int] | None:
    """The size of the first image of a topic that can be told, for calibrations that do not contain it."""
    decoder = MessageDecoder(source.path)
    for message in source.messages(Damage(), frozenset([topic])):
        try:
            if (size := image_size(decoder.image(message))) is not None:
                return size
        except UndecodableMessage:
            continue
    return None


def _attached(source: Source, parse: Callable[[bytes, str], Rig]) -> Rig | None:
    for attachment in source.attachments(Damage()):
        if attachment.name.split("/")[-1] == ATTACHMENT:
            try:
                return parse(attachment.data, "attached to the log")
            except ConfigError as error:
                raise calibration_error(f"{source.path}: {error}") from None
    return None


def _calibration_topic(source: Source, survey: Survey, image_topic: str, side: int) -> str:
    calibrations = [t for t, count in survey.of_kind("calibration").items() if count != 0]
    topic = choose_calibration(image_topic, side, calibrations)
    if topic is None:
        listed = f"; calibration topics are: {', '.join(sorted(calibrations))}" if calibrations else ""
        raise calibration_error(f"{source.path} has no calibration for topic {image_topic}{listed}")
    return topic


def _sent(source: Source, survey: Survey, choice: PairChoice) -> FoundRig[StereoRig]:
    topics = [
        _calibration_topic(source, survey, topic, side) for side, topic in enumerate((choice.left, choice.right))
    ]
    decoder = MessageDecoder(source.path)
    left, right = read_calibration_messages(source, (topics[0], topics[1]), choice.left, decoder)
    rectified = is_rectified(choice.left)
    sent = f"{left.topic} and {right.topic}"
    if gives_baseline(left, right):
        rig = rig_from_messages(source.path, left, right, rectified)
        return FoundRig(rig, f"{sent}, baseline from P", (left, right))
    frames = (left.frame_id, right.frame_id)
    right_from_left = fixed_transform(source, survey, frames[1], frames[0]) if len(set(frames)) == 2 else None
    if right_from_left is None:
        raise calibration_error(
            f"{source.path}: the baseline is not known: P of topics {left.topic} and {right.topic} gives none, and "
            f"no fixed transform leads from frame {frames[0]!r} to frame {frames[1]!r}"
        )
    rig = rig_from_messages(source.path, left, right, rectified, right_from_left)
    origin = f"{sent}, baseline from the transform between {frames[0]} and {frames[1]}"
    return FoundRig(rig, origin, (left, right))
