"""ROS 2 messages without ROS: their definitions, objects with their fields, and the bytes of each in CDR.

The standard messages used here are the same in every ROS 2. What is known of a type is compiled when it is first used.
"""

import struct
from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

_STANDARD = """\
builtin_interfaces/Time: int32 sec, uint32 nanosec
std_msgs/Header: builtin_interfaces/Time stamp, string frame_id
geometry_msgs/Point: float64 x, float64 y, float64 z
geometry_msgs/Vector3: float64 x, float64 y, float64 z
geometry_msgs/Quaternion: float64 x, float64 y, float64 z, float64 w
geometry_msgs/Pose: geometry_msgs/Point position, geometry_msgs/Quaternion orientation
geometry_msgs/PoseStamped: std_msgs/Header header, geometry_msgs/Pose pose
geometry_msgs/PoseWithCovariance: geometry_msgs/Pose pose, float64[36] covariance
geometry_msgs/PoseWithCovarianceStamped: std_msgs/Header header, geometry_msgs/PoseWithCovariance pose
geometry_msgs/Twist: geometry_msgs/Vector3 linear, geometry_msgs/Vector3 angular
geometry_msgs/TwistWithCovariance: geometry_msgs/Twist twist, float64[36] covariance
geometry_msgs/Transform: geometry_msgs/Vector3 translation, geometry_msgs/Quaternion rotation
geometry_msgs/TransformStamped: std_msgs/Header header, string child_frame_id, geometry_msgs/Transform transform
nav_msgs/Odometry: std_msgs/Header header, string child_frame_id, geometry_msgs/PoseWithCovariance pose, \
geometry_msgs/TwistWithCovariance twist
nav_msgs/Path: std_msgs/Header header, geometry_msgs/PoseStamped[] poses
tf2_msgs/TFMessage: geometry_msgs/TransformStamped[] transforms
sensor_msgs/PointField: uint8 INT8=1, uint8 UINT8=2, uint8 INT16=3, uint8 UINT16=4, uint8 INT32=5, uint8 UINT32=6, \
uint8 FLOAT32=7, uint8 FLOAT64=8, string name, uint32 offset, uint8 datatype, uint32 count
sensor_msgs/PointCloud2: std_msgs/Header header, uint32 height, uint32 width, sensor_msgs/PointField[] fields, \
bool is_bigendian, uint32 point_step, uint32 row_step, uint8[] data, bool is_dense
diagnostic_msgs/KeyValue: string key, string value
diagnostic_msgs/DiagnosticStatus: byte OK=0, byte WARN=1, byte ERROR=2, byte STALE=3, byte level, string name, \
string message, string hardware_id, diagnostic_msgs/KeyValue[] values
diagnostic_msgs/DiagnosticArray: std_msgs/Header header, diagnostic_msgs/DiagnosticStatus[] status
"""
_DEFINITIONS = {
    name: "".join(f"{field}\n" for field in fields.split(", "))
    for name, fields in (line.split(": ") for line in _STANDARD.splitlines())
}
_NUMBERS = {"bool": "?", "byte": "B", "uint8": "B", "int32": "i", "uint32": "I", "int64": "q", "float64": "d"}
_PART = "=" * 80 + "\nMSG: "  # between a definition and those of its parts

Write = Callable[[bytearray, Any], None]  # appends a value to the bytes of a message


class Message(SimpleNamespace):
    """A message, with its fields as attributes; `type_name` is package/Name."""

    type_name: str


def define(name: str, text: str) -> None:
    """Add the definition of a message (package/msg/Name): a field and its type per line, comments."""
    _DEFINITIONS[_short(name)] = text


def schema_text(name: str) -> str:
    """Return the definition of a message with those of all its parts; our own with an explanation of each field."""
    own, *others = _parts(_short(name))
    return _DEFINITIONS[own] + "".join(f"{_PART}{part}\n{_DEFINITIONS[part]}" for part in others)


def make(name: str, /, **fields: Any) -> Message:
    """Make a message, and of each dictionary among the fields the message that belongs there; arrays become flat."""
    values, name = {}, _short(name)
    for kind, field in _fields(name):
        value = fields[field]
        number = _NUMBERS.get(kind.partition("[")[0]) if kind.endswith("]") else None
        if number is not None:
            value = np.asarray(value, "<" + number).reshape(-1)
        values[field] = make(kind, **value) if isinstance(value, dict) else value
    return Message(type_name=name, **values)


def encode(message: Message) -> bytes:
    """Return the bytes of a message: little-endian CDR."""
    content = bytearray()
    _writer(message.type_name)(content, message)
    return b"\0\1\0\0" + bytes(content)


def _short(name: str) -> str:
    """Return package/Name of package/msg/Name."""
    return name.replace("/msg/", "/")


@cache
def _fields(name: str) -> list[tuple[str, str]]:
    """Type and name of each field."""
    lines = (line for line in _DEFINITIONS[name].splitlines() if not line.startswith("#") and "=" not in line)
    return [(kind, field) for kind, field in (line.split() for line in lines)]


def _parts(name: str) -> list[str]:
    """The message and all it consists of, each once, in the order in which they are met."""
    found = {name: None}
    for kind, _ in _fields(name):
        if (part := kind.removesuffix("[]")) in _DEFINITIONS:
            found |= dict.fromkeys(_parts(part))
    return list(found)


@cache
def _writer(kind: str) -> Write:
    """Return what writes values of a type."""
    kind, _, repeated = kind.partition("[")
    if repeated:
        return _list_writer(kind, counted=repeated == "]")
    if kind in _DEFINITIONS:
        return _message_writer([(field, _writer(of)) for of, field in _fields(kind)])
    if kind == "string":
        return _write_string
    packed = struct.Struct("<" + _NUMBERS[kind])

    def write(content: bytearray, value: Any) -> None:
        _align(content, packed.size)
        content.extend(packed.pack(value))

    return write


def _message_writer(fields: list[tuple[str, Write]]) -> Write:
    def write(content: bytearray, value: Any) -> None:
        for field, write_field in fields:
            write_field(content, getattr(value, field))

    return write


def _list_writer(kind: str, counted: bool) -> Write:
    write_count, write_one = _writer("uint32"), _writer(kind)
    dtype = np.dtype("<" + _NUMBERS[kind]) if kind in _NUMBERS else None

    def write(content: bytearray, values: Any) -> None:
        if counted:
            write_count(content, len(values))
        if dtype is None:
            for value in values:
                write_one(content, value)
        elif len(values):
            _align(content, dtype.itemsize)
            content.extend(np.asarray(values, dtype).tobytes())

    return write


def _write_string(content: bytearray, text: str) -> None:
    data = text.encode() + b"\0"
    _writer("uint32")(content, len(data))
    content.extend(data)


def _align(content: bytearray, size: int) -> None:
    content.extend(bytes(-len(content) % size))
