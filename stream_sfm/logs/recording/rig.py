"""The rig of a log: given by the user, attached to the log, or sent by its cameras, in this order.

An attachment precedes messages because somebody added it deliberately, whereas drivers also send CameraInfo of cameras
that were never calibrated. Messages have K, D, R and P in the ROS sense; `camera/calibration/projections.py` derives
the pose from R and P. If P gives no baseline, the transform between the frames of the two cameras does. Images that
are rectified according to their topic name are pinholes with P and neither D nor R.
"""

from collections.abc import Sequence

import numpy as np

from ...camera.calibration.document import Where, make_camera, named
from ...camera.calibration.projections import gives_baseline, pose_from_projections
from ...camera.models import Camera
from ...camera.rectification import check_rectifiable
from ...camera.rig import MonoRig, StereoRig
from ...errors import ConfigError, LogError, RigError, as_error
from ...geometry import Array, se3
from ...record import record
from ..mcap_file.message import Damage, Source
from .images import image_size
from .messages import CalibrationMessage, MessageDecoder, UndecodableMessage, decoded
from .survey import Survey
from .topics import PairChoice, choose_calibration, is_rectified
from .transforms import fixed_transform

ATTACHMENT = "calibration.toml"
REMEDY = "give the calibration of these cameras"


@record
class FoundRig:
    """A rig and its `origin` in words; `sent`: the messages from which it was made, if any."""

    rig: StereoRig | MonoRig
    origin: str
    sent: Sequence[CalibrationMessage] = ()


def find_rig(
    source: Source, survey: Survey, choice: PairChoice, calibration: Where | StereoRig | MonoRig | None, mono: bool
) -> FoundRig:
    """Return the rig of the two cameras, of the left one alone if `mono`; `calibration` as in `open_log`.

    Raises LogError naming the file, the topic and what to do; ConfigError for `calibration`.
    """
    if isinstance(calibration, StereoRig | MonoRig):
        return FoundRig(MonoRig(calibration.left) if mono else calibration, "given by the caller")
    kind = MonoRig if mono else StereoRig
    if calibration is not None:
        size = first_sizes(source, [choice.left]).get(choice.left)
        return FoundRig(kind.from_calibration(calibration, size), named(calibration))
    for attachment in source.attachments(Damage()):
        if attachment.name.split("/")[-1] == ATTACHMENT:
            try:
                rig = kind.parse_calibration(attachment.data, "attached to the log")
            except ConfigError as error:
                raise _error(f"{source.path}: {error}") from None
            return FoundRig(rig, f"attachment {ATTACHMENT}")
    topics = (choice.left,) if mono else (choice.left, choice.right)
    return rig_of_messages(source, survey, _sent_messages(source, survey, topics), is_rectified(choice.left))


def first_sizes(source: Source, topics: Sequence[str]) -> dict[str, tuple[int, int]]:
    """Return the size of the first image on each topic that shows one, for calibrations that do not contain it.

    The recording is read once, up to the last of these images.
    """
    sizes: dict[str, tuple[int, int]] = {}
    for message in decoded(source, topics, MessageDecoder.image):
        if message.topic not in sizes and (size := image_size(message)) is not None:
            sizes[message.topic] = size
            if len(sizes) == len(topics):
                break
    return sizes


def check_rig(source: Source, rig: StereoRig | MonoRig) -> None:
    """Raise LogError if the images of a log cannot be used with this rig, whatever they show."""
    if isinstance(rig, StereoRig) and (distance_m := right_is_left(rig)) is not None:
        raise _error(
            f"{source.path}: by its calibration the right camera stands {distance_m:.4g} m to the left of the left "
            "one: left and right are swapped, or the sign of P[3] is wrong: exchange the topics, or correct the sign",
            *("left", "right", "inspect"),
        )
    try:
        check_rectifiable(rig)
    except RigError as error:
        raise _error(f"{source.path}: {error}", *error.hint) from None


def right_is_left(rig: StereoRig) -> float | None:
    """Return how far the right camera stands to the left of the left one, metres; None if it stands on its right."""
    x, y, _ = se3.inverse(rig.right_from_left)[:3, 3]
    return float(-x) if x < 0 and abs(x) > abs(y) else None


def _error(problem: str, *hints: str) -> LogError:
    """Return the error about an unusable calibration in a log; its hint is to give another one."""
    return LogError(f"{problem}; {REMEDY}", hint=(*hints, "calibration"))


def rig_of_messages(source: Source, survey: Survey, sent: Sequence[CalibrationMessage], rectified: bool) -> FoundRig:
    """Return the rig from the messages `sent` by its cameras; `rectified`: their images are. Raises LogError."""
    if zero := [message.topic for message in sent if not (message.K.any() or message.P.any())]:
        raise _error(f"{source.path}: K and P of topic {zero[0]} are zero: this camera was not calibrated")
    origin = " and ".join(message.topic for message in sent)
    try:
        if len(sent) == 1:
            return FoundRig(MonoRig(_camera(sent[0], rectified)), origin, sent)
        left, right = sent
        if gives_baseline(left.P, right.P):
            r_left, r_right = (np.eye(3) if rectified else _rotation(message) for message in sent)
            pose, by = pose_from_projections(r_left, left.P, r_right, right.P), "P"
        else:
            frames = left.frame_id, right.frame_id
            found = fixed_transform(source, survey, frames[1], frames[0]) if len(set(frames)) == 2 else None
            if found is None:
                raise _error(
                    f"{source.path}: the baseline is not known: P of topics {left.topic} and {right.topic} gives none, "
                    f"and no fixed transform leads from frame {frames[0]!r} to frame {frames[1]!r}"
                )
            pose, by = found, f"the transform between {frames[0]} and {frames[1]}"
        rig = StereoRig(_camera(left, rectified), _camera(right, rectified), pose)
        return FoundRig(rig, f"{origin}, baseline from {by}", sent)
    except ConfigError as error:
        raise _error(f"{source.path}: topics {origin}: {error}") from None


def _sent_messages(source: Source, survey: Survey, image_topics: Sequence[str]) -> list[CalibrationMessage]:
    """Return the calibration of each topic at the first image of the first one, else the first one sent later."""
    calibrations = [t for t, count in survey.of_kind("calibration").items() if count != 0]
    topics = []
    for side, image_topic in enumerate(image_topics):
        if (topic := choose_calibration(image_topic, side, calibrations)) is None:
            listed = f"; calibration topics are: {', '.join(sorted(calibrations))}" if calibrations else ""
            raise _error(f"{source.path} has no calibration for topic {image_topic}{listed}")
        topics.append(topic)
    decoder, begun = MessageDecoder(source.path), False
    found: dict[str, CalibrationMessage] = {}
    problems: dict[str, str] = {}
    for message in source.messages(Damage(), frozenset((*topics, image_topics[0]))):
        topic = message.channel.topic
        if topic == image_topics[0]:
            begun = True
        elif not begun or topic not in found:
            try:
                found[topic] = decoder.calibration(message)
            except UndecodableMessage as error:
                problems[topic] = f" ({error})"
        if begun and len(found) == len(set(topics)):
            break
    if missing := [topic for topic in topics if topic not in found]:
        problem = f"{missing[0]}{problems.get(missing[0], '')}"
        raise _error(f"{source.path}: no calibration could be read from topic {problem}")
    return [found[topic] for topic in topics]


def _rotation(message: CalibrationMessage) -> Array:
    """Return R as a rotation; the identity if it was not sent. Raises ConfigError."""
    if not message.R.any():
        return np.eye(3)
    if not se3.is_rotation(message.R):
        raise ConfigError(f"{message.topic}: R is not a rotation matrix: {message.R.tolist()}")
    return se3.orthonormalise(se3.from_rotation_translation(message.R, np.zeros(3)))[:3, :3]


def _camera(message: CalibrationMessage, rectified: bool) -> Camera:
    size = message.width, message.height
    if rectified:
        return Camera(*size, message.P[:3, :3] if message.P[0, 0] > 0 else message.K, (), "none")
    with as_error(ConfigError, message.topic, ConfigError):
        return make_camera(size, message.K, message.distortion_model, message.D)
