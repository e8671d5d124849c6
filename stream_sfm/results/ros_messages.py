"""ROS 2 messages without ROS: how those that we write are made, and their bytes in CDR."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry import Array, se3
from .own_messages import DEFINITIONS
from .ros_types import Types

ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
CLOUD = "sensor_msgs/msg/PointCloud2"
PATH = "nav_msgs/msg/Path"
COVARIANCE_FIELDS = ("cov_xx", "cov_xy", "cov_xz", "cov_yy", "cov_yz", "cov_zz")
# The layout of one point in a cloud: sigma_m is the square root of the covariance's trace.
_FLOATS = ("x", "y", "z", "sigma_m", *COVARIANCE_FIELDS)
POINT_DTYPE = np.dtype([*((name, "<f4") for name in _FLOATS), ("track_id", "<u4")])
_KINDS = {"<f4": 7, "<u4": 6}  # numbers of PointField
# −1 as ROS says that a quantity is not estimated; the rest for filters that do not ask, and take its amount.
_UNKNOWN_TWIST = np.diag([-1.0, *5 * [1e6]])


@cache
def type_store() -> Types:
    """The types of messages. The first call takes 10 ms: it had better not be in a frame."""
    store = Types()
    for name in (*DEFINITIONS, ODOMETRY, POSE, TRANSFORMS, CLOUD, PATH):
        store.get_msgdef(name)  # makes what encodes it
    return store


@cache
def _arrays(name: str) -> dict[str, str]:
    return type_store().arrays(name)


def make(name: str, /, **fields: Any) -> Any:
    """Make a message (package/msg/Name) of fields and parts, which are objects with fields, too; arrays become flat."""
    for field, number in _arrays(name).items():
        fields[field] = np.asarray(fields[field], number).ravel()
    return SimpleNamespace(__msgtype__=name, **fields)


def encode(message: Any) -> bytes:
    """Return the bytes of a message: little-endian CDR."""
    return type_store().encode(message, message.__msgtype__)


def schema_text(name: str) -> str:
    """Return the definition of a message with those of all its parts; our own with an explanation of each field."""
    return type_store().schema_text(name)


def header(stamp_ns: int, frame_id: str) -> Any:
    """Make a header; its seconds have 32 bits, and wrap around."""
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
