"""The ROS 2 messages of `estimates.mcap`. Our own are defined in `own_messages.py`."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry import se3
from ..geometry.se3 import Array
from .cdr import define, make
from .own_messages import DEFINITIONS

ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
CLOUD = "sensor_msgs/msg/PointCloud2"
PATH = "nav_msgs/msg/Path"
COVARIANCE_FIELDS = ("cov_xx", "cov_xy", "cov_xz", "cov_yy", "cov_yz", "cov_zz")
# The layout of one point in a cloud: sigma_m is the square root of the covariance's trace.
POINT_DTYPE = np.dtype(
    [(name, "<f4") for name in ("x", "y", "z", "sigma_m", *COVARIANCE_FIELDS)] + [("track_id", "<u4")]
)
_KINDS = {"<f4": 7, "<u4": 6}  # numbers of PointField
_UPPER = np.triu_indices(3)
# −1 as ROS says that a quantity is not estimated; the rest for filters that do not ask, and take its amount.
_UNKNOWN_TWIST = np.diag([-1.0, *5 * [1e6]])


for _name, _text in DEFINITIONS.items():
    define(_name, _text)


def header(stamp_ns: int, frame_id: str) -> Any:
    """Make a header; its seconds have 32 bits, and wrap around."""
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    seconds = (seconds + 2**31) % 2**32 - 2**31
    return make("std_msgs/msg/Header", stamp={"sec": seconds, "nanosec": nanoseconds}, frame_id=frame_id)


def pose_of(parent_from_child: Array) -> Any:
    """Make the Pose (position and orientation) of a rigid motion (4, 4)."""
    position = dict(zip("xyz", parent_from_child[:3, 3].tolist(), strict=True))
    orientation = dict(zip("xyzw", se3.quat_xyzw_from_matrix(parent_from_child[:3, :3]).tolist(), strict=True))
    return make("geometry_msgs/msg/Pose", position=position, orientation=orientation)


def odometry(
    head: Any, child_frame_id: str, pose: Any, covariance: Array, twist: Array | None, cov_twist: Array | None
) -> Any:
    """Make an Odometry; `covariance` (6, 6) in ROS's convention, twist (6,) and its covariance in the child's axes."""
    numbers = np.zeros(6) if twist is None else twist
    linear, angular = (dict(zip("xyz", part.tolist(), strict=True)) for part in (numbers[:3], numbers[3:]))
    return make(
        ODOMETRY,
        header=head,
        child_frame_id=child_frame_id,
        pose={"pose": pose, "covariance": covariance},
        twist={
            "twist": {"linear": linear, "angular": angular},
            "covariance": _UNKNOWN_TWIST if cov_twist is None else cov_twist,
        },
    )


def transforms(*stamped: tuple[Any, str, Any]) -> Any:
    """Make a TFMessage of headers, child frames and their poses in the frames of the headers."""
    found = []
    for head, child_frame_id, pose in stamped:
        name, at = "geometry_msgs/msg/TransformStamped", pose.position
        inside = {"translation": {"x": at.x, "y": at.y, "z": at.z}, "rotation": pose.orientation}
        found.append(make(name, header=head, child_frame_id=child_frame_id, transform=inside))
    return make(TRANSFORMS, transforms=found)


def cloud(head: Any, track_ids: NDArray[np.int64], points: Array, cov: Array) -> Any:
    """Make a PointCloud2 of points (n, 3) with covariances (n, 3, 3)."""
    rows = np.zeros(len(points), POINT_DTYPE)
    rows["x"], rows["y"], rows["z"] = np.asarray(points).reshape(-1, 3).T
    upper = np.asarray(cov).reshape(-1, 3, 3)[:, _UPPER[0], _UPPER[1]]
    with np.errstate(over="ignore"):
        for name, column in zip(COVARIANCE_FIELDS, upper.T, strict=True):
            rows[name] = column
        rows["sigma_m"] = np.sqrt(np.maximum(upper[:, [0, 3, 5]].sum(axis=1), 0))
    rows["track_id"] = np.asarray(track_ids, dtype=np.int64) & 0xFFFFFFFF
    return make(
        CLOUD,
        header=head,
        height=1,
        width=len(rows),
        fields=_point_fields(),
        is_bigendian=False,
        point_step=POINT_DTYPE.itemsize,
        row_step=rows.nbytes,
        data=np.frombuffer(rows.tobytes(), np.uint8),
        is_dense=True,
    )


@cache
def _point_fields() -> list[Any]:
    return [
        make("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=_KINDS[kind.str], count=1)
        for name, (kind, offset, *_) in (POINT_DTYPE.fields or {}).items()
    ]
