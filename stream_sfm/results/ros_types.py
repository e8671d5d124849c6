"""The types of the ROS 2 messages that we write: their definitions, and what encodes them as CDR.

rosbags generates the code that encodes. Its own types, and what it reads definitions with, are not imported: they take
60 ms and 30 ms.
"""

from types import SimpleNamespace
from typing import Any, cast

from rosbags.interfaces import Nodetype
from rosbags.serde.cdr import generate_getsize_cdr, generate_serialize_cdr
from rosbags.serde.utils import SIZEMAP

from .own_messages import DEFINITIONS

# The standard types that are used; they are the same in every ROS 2.
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
_PART = "=" * 80  # between a definition and those of its parts
_LITTLE_ENDIAN = b"\0\1\0\0"  # the encapsulation of CDR
_LISTS = (Nodetype.ARRAY, Nodetype.SEQUENCE)
Field = tuple[str, Any]  # a name, and what rosbags says of its type


class Types:
    """The standard types and our own by name (package/msg/Name); a type store to what rosbags generates.

    `fields`: those of each type; `made`: the functions that encode it, made when it is first used, which takes 0.5 ms.
    """

    def __init__(self) -> None:
        lines = (line.split(": ", 1) for line in _STANDARD.splitlines())
        standard = {_full(name): fields.replace(", ", "\n") + "\n" for name, fields in lines}
        self._texts = standard | DEFINITIONS
        self.fields = {name: _fields_of(text) for name, text in self._texts.items()}
        self.made: dict[str, SimpleNamespace] = {}

    def get_msgdef(self, name: str) -> SimpleNamespace:
        """Return the functions that encode a type, as rosbags asks for them."""
        if name not in self.made:
            fields, store = self.fields[name], cast(Any, self)
            getsize, size = generate_getsize_cdr(fields, store)
            encode = generate_serialize_cdr(fields, store, "le")
            made = SimpleNamespace(fields=fields, getsize_cdr=getsize, size_cdr=size, serialize_cdr_le=encode)
            self.made[name] = made
        return self.made[name]

    def encode(self, message: Any, name: str) -> bytes:
        """Return the bytes of a message of a type: little-endian CDR."""
        made = self.get_msgdef(name)
        encoded = bytearray(len(_LITTLE_ENDIAN) + made.getsize_cdr(0, message, self))
        encoded[: len(_LITTLE_ENDIAN)] = _LITTLE_ENDIAN
        made.serialize_cdr_le(memoryview(encoded)[len(_LITTLE_ENDIAN) :], 0, message, self)
        return bytes(encoded)

    def arrays(self, name: str) -> dict[str, str]:
        """Return the fields of a type that are arrays of numbers, and of which."""
        elements = {field: of[0] for field, (kind, of) in self.fields[name] if kind in _LISTS}
        numbers = {field: base[0] for field, (kind, base) in elements.items() if kind == Nodetype.BASE}
        return {field: number for field, number in numbers.items() if number != "string"}

    def schema_text(self, name: str) -> str:
        """Return the definition of a type with those of all its parts."""
        parts = {part: None for part in self._parts(name)}
        return "".join(
            [self._texts[name], *(f"{_PART}\nMSG: {_short(part)}\n{self._texts[part]}" for part in parts)]
        )

    def _parts(self, name: str) -> list[str]:
        """The types of the fields of a type, each followed by those of its own."""
        elements = (of[0] if kind in _LISTS else (kind, of) for _, (kind, of) in self.fields[name])
        found = [of for kind, of in elements if kind == Nodetype.NAME]
        return [each for part in found for each in (part, *self._parts(part))]


def _fields_of(definition: str) -> list[Field]:
    """The fields in a definition, which has a field, a constant or a comment in each line."""
    lines = (line.split() for line in definition.splitlines() if not line.startswith("#") and "=" not in line)
    return [(name, _described(kind)) for kind, name in lines]


def _described(kind: str) -> tuple[Nodetype, Any]:
    """What rosbags says of a type such as float64, std_msgs/Header, float64[36], string[]."""
    name, is_list, length = kind.removesuffix("]").partition("[")
    is_plain = name == "string" or name in SIZEMAP
    element = (Nodetype.BASE, (name, 0)) if is_plain else (Nodetype.NAME, _full(name))
    if not is_list:
        return element
    return (Nodetype.ARRAY, (element, int(length))) if length else (Nodetype.SEQUENCE, (element, 0))


def _full(name: str) -> str:
    return name.replace("/", "/msg/")


def _short(name: str) -> str:
    return name.replace("/msg/", "/")
