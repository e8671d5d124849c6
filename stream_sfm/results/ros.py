"""The package's pose and covariance as a ROS 2 `nav_msgs/msg/Odometry`.

Ours: truth = estimate·Exp(ξ), ξ = (translation, rotation) in axes of the camera. ROS (REP 103): position and
rotation errors along the fixed axes of the parent frame, x y z then rotation about x, y, z, row-major. To first
order t' = t + R ρ and R' = R·Exp(ω) = Exp(R ω)·R, so Σ_ros = B Σ Bᵀ with B = diag(R, R): each half is rotated,
no lever arm enters.
"""

import struct

import numpy as np

from ..geometry import se3
from ..geometry.se3 import Array

SCHEMA_NAME = "nav_msgs/msg/Odometry"


def fixed_axis_covariance(rotation: Array, cov_pose: Array) -> Array:
    """ROS's covariance (6, 6) of a pose with rotation (3, 3) and our covariance (6, 6); NaN if that is not finite."""
    if not np.isfinite(cov_pose).all():
        return np.full((6, 6), np.nan)
    b = np.zeros((6, 6))
    b[:3, :3] = b[3:, 3:] = rotation
    return b @ cov_pose @ b.T


def body_covariance(rotation: Array, cov_fixed_axis: Array) -> Array:
    """Our covariance (6, 6) of ROS's: the inverse of `fixed_axis_covariance`."""
    return fixed_axis_covariance(rotation.T, cov_fixed_axis)


def encode_odometry(
    stamp_ns: int, frame_id: str, child_frame_id: str, world_from_cam: Array, cov_pose: Array
) -> bytes:
    """Encode the message in little-endian CDR. The twist is not estimated: zero, its covariance begins with −1."""
    rotation = world_from_cam[:3, :3]
    pose = [*world_from_cam[:3, 3], *se3.quat_xyzw_from_matrix(rotation)]
    twist_covariance = np.zeros(36)
    twist_covariance[0] = -1.0
    body = struct.pack("<II", stamp_ns // 10**9 & 0xFFFFFFFF, stamp_ns % 10**9)
    for text in (frame_id, child_frame_id):
        raw = text.encode() + b"\0"
        body += b"\0" * (-len(body) % 4) + struct.pack("<I", len(raw)) + raw
    body += b"\0" * (-len(body) % 8)  # doubles are aligned, counted from after the encapsulation header
    body += struct.pack("<7d", *pose) + fixed_axis_covariance(rotation, cov_pose).astype("<f8").tobytes()
    body += struct.pack("<6d", *(0.0,) * 6) + twist_covariance.astype("<f8").tobytes()
    return b"\0\1\0\0" + body


_RULE = "=" * 80
SCHEMA_TEXT = f"""# Position and orientation in header.frame_id of child_frame_id, with uncertainty
std_msgs/Header header
string child_frame_id
geometry_msgs/PoseWithCovariance pose
geometry_msgs/TwistWithCovariance twist
{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{_RULE}
MSG: geometry_msgs/PoseWithCovariance
geometry_msgs/Pose pose
float64[36] covariance
{_RULE}
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
{_RULE}
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
{_RULE}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
{_RULE}
MSG: geometry_msgs/TwistWithCovariance
geometry_msgs/Twist twist
float64[36] covariance
{_RULE}
MSG: geometry_msgs/Twist
geometry_msgs/Vector3 linear
geometry_msgs/Vector3 angular
{_RULE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
