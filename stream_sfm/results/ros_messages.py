"""ROS 2 messages without ROS: the standard ones and our own (`own_messages.py`), their bytes in CDR, their definitions.

The standard messages used here are the same in every ROS 2.
"""

from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry import Array, se3
from .own_messages import DEFINITIONS

ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
CLOUD = "sensor_msgs/msg/PointCloud2"
PATH = "nav_msgs/msg/Path"
COVARIANCE_FIELDS = ("cov_xx", "cov_xy", "cov_xz", "cov_yy", "cov_yz", "cov_zz")
# The layout of one point in a cloud: sigma_m is the square root of the trace of the covariance.
_FLOATS = ("x", "y", "z", "sigma_m", *COVARIANCE_FIELDS)
POINT_DTYPE = np.dtype([*((name, "<f4") for name in _FLOATS), ("track_id", "<u4")])
_KINDS = {"<f4": 7, "<u4": 6}  # type numbers of PointField
# −1 means in ROS that a quantity is not estimated; the rest is for filters that use its absolute value unchecked.
_UNKNOWN_TWIST = np.diag([-1.0, *5 * [1e6]])

# Only the types in use: rosbags has all types of ROS 2, but takes 60 ms and 5 MiB for them.
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


# A letter of the module `struct`, and NumPy's type; strings and parts are not here.
_NUMBERS = {
    "bool": "?",
    "byte": "B",
    "int8": "b",
    "uint8": "B",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "float64": "d",
}
Field = tuple[str, Any, int | None, int]  # name, kind, count and size, as `core.encoded` takes them


@cache
def _definitions() -> dict[str, str]:
    """Return the fields of the standard messages and of our own, one per line."""
    standard = (line.split(": ", 1) for line in _STANDARD.splitlines())
    return {name.replace("/", "/msg/"): fields.replace(", ", "\n") for name, fields in standard} | DEFINITIONS


def _lines(name: str) -> Iterator[tuple[str, str, str]]:
    """Yield type, name and array (as `36]`, `]`, or empty) of each field of a message."""
    for line in _definitions()[name].splitlines():
        if (plain := line.partition("#")[0]).strip() and "=" not in plain:
            kind, field = plain.split()
            kind, _, array = kind.partition("[")
            yield kind.replace("/", "/msg/"), field, array


@cache
def fields_of(name: str) -> tuple[Field, ...]:
    """Return the fields of a message."""
    found: list[Field] = []
    for kind, field, array in _lines(name):
        code: Any = "s" if kind == "string" else _NUMBERS.get(kind) or fields_of(kind)
        count = None if not array else int(array.rstrip("]") or -1)
        found.append((field, code, count, np.dtype(code).itemsize if kind in _NUMBERS else 0))
    return tuple(found)


@cache
def _arrays(name: str) -> Mapping[str, str]:
    """Return the fields of a type that are arrays of numbers, with their types."""
    return {field: kind for field, kind, count, size in fields_of(name) if count is not None and size}


def make(name: str, /, **fields: Any) -> Any:
    """Make a message (package/msg/Name) from fields and parts, which also have fields; arrays become flat."""
    for field, number in _arrays(name).items():
        fields[field] = np.asarray(fields[field], number).ravel()
    return SimpleNamespace(__msgtype__=name, **fields)


def encode(messages: Iterable[Any]) -> list[bytes]:
    """Return the bytes of messages: little-endian CDR."""
    given = list(messages)
    return core.encoded([fields_of(message.__msgtype__) for message in given], given)


def schema_text(name: str) -> str:
    """Return the definition of a message and of all its parts; our own explain each field."""
    parts: dict[str, str] = {}

    def add(kind: str) -> None:
        for part, *_ in _lines(kind):
            if part in _definitions() and part not in parts:
                parts[part] = _definitions()[part]
                add(part)

    add(name)
    texts = (f"{_PART}\nMSG: {part.replace('/msg/', '/')}\n{text}\n" for part, text in parts.items())
    own = _definitions()[name]
    return "".join([own if name in DEFINITIONS else f"{own}\n", *texts])


def header(stamp_ns: int, frame_id: str) -> Any:
    """Make a header; its seconds have 32 bits and wrap around."""
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    stamp = SimpleNamespace(sec=(seconds + 2**31) % 2**32 - 2**31, nanosec=nanoseconds)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)


def pose_of(parent_from_child: Array) -> Any:
    """Make the Pose (position and orientation) of a rigid motion (4, 4)."""
    x, y, z, w = se3.quat_xyzw_from_matrix(parent_from_child[:3, :3]).tolist()
    position, orientation = _vector(parent_from_child[:3, 3]), SimpleNamespace(x=x, y=y, z=z, w=w)
    return make("geometry_msgs/msg/Pose", position=position, orientation=orientation)


def with_covariance(pose: Any, covariance: Array) -> Any:
    """Make a PoseWithCovariance; `covariance` (6, 6) in ROS's convention."""
    return make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance)


def odometry(head: Any, child_frame_id: str, pose: Any, twist: Array | None, cov_twist: Array | None) -> Any:
    """Make an Odometry of a pose with covariance, and of a twist (6,) with its covariance in the child's axes."""
    numbers = np.zeros(6) if twist is None else twist
    moving = SimpleNamespace(linear=_vector(numbers[:3]), angular=_vector(numbers[3:]))
    covariance = (_UNKNOWN_TWIST if cov_twist is None else cov_twist).ravel()
    stated = SimpleNamespace(twist=moving, covariance=covariance)
    return make(ODOMETRY, header=head, child_frame_id=child_frame_id, pose=pose, twist=stated)


def transforms(*stamped: tuple[Any, str, Any]) -> Any:
    """Make a TFMessage of headers, child frames and their poses in the frames of the headers."""
    found = []
    for head, child, pose in stamped:
        moved = SimpleNamespace(translation=pose.position, rotation=pose.orientation)
        kind = "geometry_msgs/msg/TransformStamped"
        found.append(make(kind, header=head, child_frame_id=child, transform=moved))
    return make(TRANSFORMS, transforms=found)


def cloud(head: Any, track_ids: NDArray[np.int64], points: Array, cov: Array) -> Any:
    """Make a PointCloud2 of points (n, 3) with covariances (n, 3, 3)."""
    numbers = np.empty((len(points), len(_FLOATS)))
    numbers[:, :3] = points
    numbers[:, 3] = np.sqrt(np.maximum(np.trace(cov, axis1=1, axis2=2), 0))
    numbers[:, 4:7], numbers[:, 7:9], numbers[:, 9] = cov[:, 0], cov[:, 1, 1:], cov[:, 2, 2]
    rows = np.empty((len(points), len(_FLOATS) + 1), "<u4")
    with np.errstate(over="ignore"):
        rows[:, :-1] = numbers.astype("<f4").view("<u4")
    rows[:, -1] = np.asarray(track_ids, np.int64) & 0xFFFFFFFF
    return make(
        CLOUD,
        header=head,
        height=1,
        width=len(rows),
        fields=_point_fields(),
        is_bigendian=False,
        point_step=POINT_DTYPE.itemsize,
        row_step=rows.nbytes,
        data=rows.view(np.uint8),
        is_dense=True,
    )


def _vector(numbers: Array) -> Any:
    x, y, z = numbers.tolist()
    return SimpleNamespace(x=x, y=y, z=z)


@cache
def _point_fields() -> list[Any]:
    return [
        make("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=_KINDS[kind.str], count=1)
        for name, (kind, offset, *_) in (POINT_DTYPE.fields or {}).items()
    ]
