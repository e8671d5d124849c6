"""ROS 2 messages without ROS: their definitions, objects with their fields, and the bytes of each in CDR.

The standard messages used here are the same in every ROS 2. What is known of a type is compiled when it is first used:
numbers that follow each other, in parts of parts, too, are packed in one go.
"""

import struct
from collections.abc import Callable, Iterator
from functools import cache
from operator import attrgetter
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
_COUNT = struct.Struct("<I")

Write = Callable[[bytearray, Any], None]  # appends fields of a message to its bytes


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
    """Make a message of fields and parts, which are objects with fields, too; arrays become flat."""
    flat = {key: value.ravel() if isinstance(value, np.ndarray) else value for key, value in fields.items()}
    return Message(type_name=_short(name), **flat)


def encode(message: Message) -> bytes:
    """Return the bytes of a message: little-endian CDR."""
    content = bytearray()
    for write in _writers(message.type_name):
        write(content, message)
    return b"\0\1\0\0" + bytes(content)


def _short(name: str) -> str:
    """Return package/Name of package/msg/Name."""
    return name.replace("/msg/", "/")


def _fields(name: str) -> list[list[str]]:
    """Type and name of each field."""
    return [
        line.split() for line in _DEFINITIONS[name].splitlines() if not line.startswith("#") and "=" not in line
    ]


def _parts(name: str) -> list[str]:
    """The message and all it consists of, each once, in the order in which they are met."""
    found = {name: None}
    for kind, _ in _fields(name):
        if (part := kind.removesuffix("[]")) in _DEFINITIONS:
            found |= dict.fromkeys(_parts(part))
    return list(found)


def _leaves(name: str, where: str = "") -> Iterator[tuple[str, str]]:
    """Type and dotted name of all fields that are numbers, texts or lists."""
    for kind, field in _fields(name):
        if kind in _DEFINITIONS:
            yield from _leaves(kind, f"{where}{field}.")
        else:
            yield kind, where + field


@cache
def _writers(name: str) -> list[Write]:
    """What writes a message, one part after the other."""
    found: list[Write] = []
    paths: list[str] = []
    codes = ""
    for kind, path in _leaves(name):
        if kind in _NUMBERS:
            paths.append(path)
            codes += _NUMBERS[kind]
            continue
        if paths:
            found.append(_numbers(paths, codes))
            paths, codes = [], ""
        found.append(_text(path) if kind == "string" else _list(path, *kind.rstrip("]").split("[")))
    return [*found, _numbers(paths, codes)] if paths else found


def _numbers(paths: list[str], codes: str) -> Write:
    """Write numbers that follow each other, each at a multiple of its size; one format for each place to begin at."""
    packs = [_format(codes, start).pack for start in range(8)]
    get = attrgetter(*paths)

    def write(content: bytearray, message: Any) -> None:
        content += packs[len(content) % 8](*get(message))

    def write_one(content: bytearray, message: Any) -> None:
        content += packs[len(content) % 8](get(message))

    return write if len(paths) > 1 else write_one


def _format(codes: str, at: int) -> struct.Struct:
    text = "<"
    for code in codes:
        size = struct.calcsize(f"<{code}")
        text += "x" * (-at % size) + code
        at += -at % size + size
    return struct.Struct(text)


def _text(path: str) -> Write:
    get = attrgetter(path)
    return lambda content, message: _write_text(content, get(message))


def _write_text(content: bytearray, text: str) -> None:
    data = text.encode() + b"\0"
    _write_count(content, len(data))
    content += data


def _write_count(content: bytearray, count: int) -> None:
    content += bytes(-len(content) % 4) + _COUNT.pack(count)


def _list(path: str, kind: str, length: str) -> Write:
    """Write a list of numbers, texts or messages; its count stands before it unless the type gives a `length`."""
    get = attrgetter(path)
    if kind in _NUMBERS:
        dtype = np.dtype("<" + _NUMBERS[kind])

        def write(content: bytearray, message: Any) -> None:
            values = np.asarray(get(message), dtype)
            if not length:
                _write_count(content, values.size)
            if values.size:
                content += bytes(-len(content) % dtype.itemsize) + values.tobytes()

        return write
    writers = [_write_text] if kind == "string" else _writers(kind)

    def write_parts(content: bytearray, message: Any) -> None:
        parts = get(message)
        _write_count(content, len(parts))
        for part in parts:
            for write in writers:
                write(content, part)

    return write_parts
