"""Decodes the messages of four dialects (Foxglove protobuf and JSON, ROS 2, ROS 1) into three records."""

import base64
import json
import math
import re
from array import array
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from mcap.well_known import MessageEncoding

from ...errors import LogError
from ...geometry import Array, se3
from ...record import record
from ...system.inputs import INT64, LIMITS, Decoder
from ..mcap_file.message import Channel, Damage, Message, Source

T = TypeVar("T")

_PACKAGES = (
    "foxglove", "foxglove_msgs", "sensor_msgs", "geometry_msgs", "nav_msgs", "tf2_msgs", "tf",
    "ffmpeg_image_transport_msgs", "theora_image_transport",
)  # fmt: skip
_KINDS = {
    "RawImage": "image", "Image": "image", "CompressedImage": "image", "CompressedVideo": "video",
    "FFMPEGPacket": "video", "Packet": "video",
    "CameraCalibration": "calibration", "CameraInfo": "calibration",
    "PoseInFrame": "pose", "PoseStamped": "pose", "PoseWithCovarianceStamped": "pose", "Odometry": "pose",
    "FrameTransform": "transform", "FrameTransforms": "transform", "TransformStamped": "transform",
    "TFMessage": "transform", "tfMessage": "transform", "Transform": "transform", "Imu": "imu",
}  # fmt: skip

# Topics of librealsense's recordings, which name no frames: each stream is one, and so is each reference of poses.
_REALSENSE = re.compile(r"(/device_\d+)(/sensor_\d+/\w+_\d+)/(?:\w+/)*(\w+)")
_MISSING = object()
_QUATERNION_NORMS = (0.5, 2.0)  # beyond any rounding error; outside them the numbers are not a rotation


class UndecodableMessage(Exception):
    """One message does not fit its schema; the next one may."""


@record
class ImageMessage:
    """One image as recorded, not decoded.

    `encoding`: pixel layout of a raw image, or format of a compressed one, whose `width`, `height` and `step`
    (bytes per row) are 0.
    """

    topic: str
    stamp_ns: int
    frame_id: str
    compressed: bool
    encoding: str
    data: bytes
    width: int = 0
    height: int = 0
    step: int = 0
    big_endian: bool = False
    calibration: "CalibrationMessage | None" = None  # valid for its camera at that time; None: not requested


@record
class CalibrationMessage:
    """A camera's calibration in the ROS sense: `K` (3, 3), `R` (3, 3), `P` (3, 4), `D`, as sent."""

    topic: str
    frame_id: str
    width: int
    height: int
    distortion_model: str
    D: tuple[float, ...]
    K: Array
    R: Array
    P: Array

    def changes(self, other: "CalibrationMessage") -> list[str]:
        """Return the names of the fields in which another message of the same camera differs."""
        sizes = (self.width, self.height), (other.width, other.height)
        fields: list[tuple[str, Any, Any]] = [("the image size", *sizes), ("D", self.D, other.D)]
        fields += [("K", self.K, other.K), ("R", self.R, other.R), ("P", self.P, other.P)]
        found = [name for name, a, b in fields if not same_numbers(a, b)]
        return found + (["the distortion model"] if self.distortion_model != other.distortion_model else [])


@record
class PoseMessage:
    """One pose, `parent_from_child` (4, 4) at `stamp_ns`; `child` is empty if the message names none."""

    stamp_ns: int
    parent: str
    child: str
    parent_from_child: Array


@record
class ImuMessage:
    """One sample of an inertial unit: `gyro_rad_s` and `accel_m_s2` (3,), NaN where the message has none."""

    topic: str
    stamp_ns: int
    frame_id: str
    gyro_rad_s: Array
    accel_m_s2: Array


def kind_of(schema_name: str) -> str:
    """Return the kind of messages of a schema: image, video, calibration, pose, transform, or empty for others."""
    parts = schema_name.replace("/", ".").split(".")
    return _KINDS.get(parts[-1], "") if parts[0] in _PACKAGES else ""


class MessageDecoder:
    """Decodes the messages of one reading of a log; `path` names it in errors."""

    def __init__(self, path: str | Path) -> None:
        self._path = path
        self._decoders: dict[Channel, Decoder] = {}

    def _decode(self, message: Message, max_bytes: int | None = None) -> Any:
        if max_bytes is not None and len(message.data) > max_bytes:
            raise UndecodableMessage(f"{message.channel.topic}: {len(message.data)} bytes, over {max_bytes}")
        decoder = self._decoders.get(message.channel)
        if decoder is None:
            if len(self._decoders) >= LIMITS.decoders:
                self._decoders.clear()
            decoder = self._decoders[message.channel] = self._find(message.channel)
        try:
            return decoder(message.data)
        except Exception as error:  # libraries raise many kinds of errors for damaged bytes
            what = f"{message.channel.topic}: a message of {len(message.data)} bytes"
            raise UndecodableMessage(f"{what} does not fit its schema ({type(error).__name__}: {error})") from None

    def _find(self, channel: Channel) -> Decoder:
        where = f"{self._path}: topic {channel.topic}"
        if not channel.schema_name:
            raise LogError(f"{where} has no schema, so its messages cannot be read")
        try:
            if channel.message_encoding == "json":
                return _decode_json
            if len(channel.definition) > LIMITS.small_bytes:
                raise ValueError(f"a definition of {len(channel.definition)} bytes")
            if (decoder := _by_definition(channel)) is not None:
                return decoder
        except Exception as error:  # libraries raise many kinds of errors for a broken definition
            problem = f"{error}".splitlines()[0] if f"{error}" else type(error).__name__
            raise LogError(f"{where}: its schema {channel.schema_name!r} cannot be read ({problem})") from None
        raise LogError(
            f"{where}: messages in {channel.message_encoding!r} with a {channel.schema_encoding!r} schema are not "
            "supported; supported are protobuf, json, cdr with ros2msg or ros2idl, and ros1 with ros1msg"
        )

    def image(self, message: Message) -> ImageMessage:
        """Decode an image. Raises UndecodableMessage; LogError where the topic as a whole cannot be read."""
        return self._record(message, image_of)

    def calibration(self, message: Message) -> CalibrationMessage:
        """Decode a calibration message. Raises as `image`."""
        return self._record(message, _calibration, LIMITS.small_bytes)

    def poses(self, message: Message) -> list[PoseMessage]:
        """Decode the poses in a message, several for a list of transforms. Raises as `image`."""
        return self._record(message, _poses, LIMITS.small_bytes)

    def imu(self, message: Message) -> ImuMessage:
        """Decode a sample of an inertial unit. Raises as `image`."""
        return self._record(message, _imu, LIMITS.small_bytes)

    def _record(self, message: Message, make: Callable[[str, Any], T], max_bytes: int | None = None) -> T:
        decoded, topic = self._decode(message, max_bytes), message.channel.topic
        try:
            return make(topic, decoded)
        except (ValueError, TypeError, OverflowError) as error:  # a field of another kind, JSON's infinity
            raise UndecodableMessage(f"{topic}: {error}") from None


def decoded(
    source: Source,
    topics: Iterable[str],
    decode: Callable[[MessageDecoder, Message], T],
    tell: Callable[[str], object] | None = None,
) -> Iterator[T]:
    """Yield the result of `decode` for each message on some topics; messages that it cannot decode are skipped.

    `tell` is called with the reason for the first skipped one. Raises LogError if a topic as a whole cannot be read.
    """
    decoder = MessageDecoder(source.path)
    for message in source.messages(Damage(), frozenset(topics)):
        try:
            made = decode(decoder, message)
        except UndecodableMessage as error:
            if tell is not None:
                tell(str(error))
                tell = None
            continue
        yield made


def image_of(topic: str, m: Any) -> ImageMessage:
    """Return the image in a message with the fields of an image. Raises UndecodableMessage, ValueError, TypeError."""
    known = topic, _stamp_ns(m), _frame_id(m, topic)
    data = _bytes(_get(m, "data"))
    if _has(m, "format") or _has(m, "pts"):  # pts: of ffmpeg_image_transport, which also has width and height
        return ImageMessage(*known, True, _text(_get(m, "format", "encoding")), data)
    width, height, step = (int(_get(m, name)) for name in ("width", "height", "step"))
    big_endian = bool(_get(m, "is_bigendian", default=0))
    return ImageMessage(*known, False, _text(_get(m, "encoding")), data, width, height, step, big_endian)


def _calibration(topic: str, m: Any) -> CalibrationMessage:
    return CalibrationMessage(
        topic=topic,
        frame_id=_frame_id(m, topic),
        width=int(_get(m, "width")),
        height=int(_get(m, "height")),
        distortion_model=_text(_get(m, "distortion_model", default="")).strip().lower().replace(" ", "_"),
        D=tuple(float(x) for x in _get(m, "D", "d", default=())),
        K=_matrix(_get(m, "K", "k", default=()), 3, 3),
        R=_matrix(_get(m, "R", "r", default=()), 3, 3),
        P=_matrix(_get(m, "P", "p", default=()), 3, 4),
    )


def _poses(topic: str, m: Any) -> list[PoseMessage]:
    if _has(m, "transforms"):
        return [_pose(t) for t in _get(m, "transforms")]
    if _has(m, "header") or _has(m, "parent_frame_id") or _has(m, "pose"):
        return [_pose(m)]
    if (known := _REALSENSE.fullmatch(topic)) is None:
        raise ValueError("a pose that names no frames")
    # points of the reference -> points of the stream
    return [PoseMessage(0, known[1] + known[2], f"{known[1]}/{known[3]}", _matrix_of(m, "translation", "rotation"))]


def _imu(topic: str, m: Any) -> ImuMessage:
    """Return a sample; ROS marks quantities that are not measured by −1 as the first number of the covariance."""
    values = []
    for name in ("angular_velocity", "linear_acceleration"):
        of, cov = _get(m, name), _get(m, f"{name}_covariance", default=())
        missing = len(cov) > 0 and float(cov[0]) == -1
        values.append(np.full(3, np.nan) if missing else np.array([float(_get(of, axis)) for axis in "xyz"]))
    return ImuMessage(topic, _stamp_ns(m), _frame_id(m, topic), *values)


def same_numbers(a: Any, b: Any) -> bool:
    """Whether two lists of numbers that were sent twice are equal up to rounding.

    The rounding of a double sent as text is far smaller than the tolerance, and any change that matters is far larger.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    if a.shape != b.shape:
        return False
    # they nearly always have the same bytes; `allclose` takes fifty times as long to find this
    return a.tobytes() == b.tobytes() or np.allclose(a, b, rtol=1e-6, atol=1e-6, equal_nan=True)


def _by_definition(channel: Channel) -> Decoder | None:
    """Return the decoder of protobuf or of ROS; only the library that the log needs is imported."""
    if channel.message_encoding == MessageEncoding.Protobuf:
        from .protobuf import protobuf_decoder

        return protobuf_decoder(channel)

    from .ros import ros_decoder

    return ros_decoder(channel.message_encoding, channel.schema_encoding, channel.schema_name, channel.definition)


def _decode_json(data: bytes) -> Any:
    """Parse JSON as `json.loads` does. Raises ValueError for more values than any message has."""
    values = sum(data.count(mark) for mark in (b",", b"[", b"{"))  # an upper bound, as text may also contain them
    if values > LIMITS.json_values:
        raise ValueError(f"up to {values} values")
    if len(data) > LIMITS.json_text_bytes and not data.isascii():
        raise ValueError("a long text that is not ASCII")
    return json.loads(data)


def _has(message: Any, name: str) -> bool:
    return name in message if isinstance(message, dict) else hasattr(message, name)


def _get(message: Any, *names: str, default: Any = None) -> Any:
    is_json = isinstance(message, dict)
    for name in names:
        value = message.get(name, _MISSING) if is_json else getattr(message, name, _MISSING)
        if value is not _MISSING:
            return value
    if default is None:
        raise ValueError(f"the message lacks the field {names[0]}")
    return default


def _stamp_ns(message: Any) -> int:
    stamp = _get(message, "timestamp") if _has(message, "timestamp") else _get(_get(message, "header"), "stamp")
    sec = int(_get(stamp, "sec", "seconds", "secs"))
    stamp_ns = sec * 1_000_000_000 + int(_get(stamp, "nanosec", "nsec", "nanos", "nsecs"))
    if not -INT64 <= stamp_ns < INT64:
        raise ValueError(f"a stamp of {sec} s")
    return stamp_ns


def _frame_id(message: Any, topic: str = "") -> str:
    if _has(message, "header"):
        message = _get(message, "header")
    frame_id = _text(_get(message, "frame_id", "parent_frame_id", default="")).lstrip("/")
    known = _REALSENSE.fullmatch(topic) if frame_id in ("", "0") else None
    return frame_id if known is None else known[1] + known[2]


def _text(value: Any) -> str:
    """Return a name as encodable Unicode: JSON may hold half a surrogate pair. Raises ValueError if it is too long."""
    if len(text := "" if value is None else str(value)) > LIMITS.name:  # JSON's null
        raise ValueError(f"a name of {len(text)} characters")
    return text.encode("utf-8", "backslashreplace").decode()


def _bytes(data: Any) -> bytes:
    if isinstance(data, bytes):
        return data
    if isinstance(data, str):
        return base64.b64decode(data, validate=True)
    if isinstance(data, list | np.ndarray | array):  # array is that of rclpy
        return bytes(data)
    raise ValueError(f"data of type {type(data).__name__}")  # bytes(n) with a number would give n zeros


def _matrix(values: Any, rows: int, columns: int) -> Array:
    """Return a matrix as sent; all zeros where nothing was sent."""
    found = np.array([float(x) for x in values], dtype=float)
    if found.size not in (0, rows * columns):
        raise ValueError(f"a calibration matrix has {found.size} numbers instead of {rows * columns}")
    return found.reshape(rows, columns) if found.size else np.zeros((rows, columns))


def _pose(message: Any) -> PoseMessage:
    if _has(message, "rotation") and _has(message, "translation"):  # foxglove.FrameTransform
        body, position, rotation = message, "translation", "rotation"
    elif _has(message, "transform"):
        body, position, rotation = _get(message, "transform"), "translation", "rotation"
    else:
        body, position, rotation = _get(message, "pose"), "position", "orientation"
        if _has(body, "pose"):  # with covariance
            body = _get(body, "pose")
    child = _text(_get(message, "child_frame_id", default="")).lstrip("/")
    return PoseMessage(_stamp_ns(message), _frame_id(message), child, _matrix_of(body, position, rotation))


def _matrix_of(body: Any, position: str, rotation: str) -> Array:
    t, q = _get(body, position), _get(body, rotation)
    quat_xyzw, position_m = [float(_get(q, x)) for x in "xyzw"], [float(_get(t, x)) for x in "xyz"]
    if not _QUATERNION_NORMS[0] < math.hypot(*quat_xyzw) < _QUATERNION_NORMS[1]:  # NaN is in no order
        raise ValueError(f"a pose with the quaternion {quat_xyzw}")
    if not all(map(math.isfinite, position_m)):
        raise ValueError("a pose that is not finite")
    return se3.from_rotation_translation(se3.matrix_from_quat_xyzw(quat_xyzw), position_m)
