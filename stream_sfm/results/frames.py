"""Coordinate frames and covariances of ROS, made from those of the package, whose world is the first left camera.

REP 103: a body has x forward, y left, z up; a camera has z forward, x right, y down. With a base frame, the fixed frame
is the base at the start, so z is up if it is up for the robot.
"""

import numpy as np

from ..config import RosConfig
from ..geometry import Array, se3
from ..inertial.upright import BODY_FROM_CAMERA_AXES


def fixed_axis_covariance(rotation: Array, cov_pose: Array) -> Array:
    """Return ROS's covariance (6, 6) of a pose with rotation (3, 3) and our covariance (6, 6); NaN if not finite.

    Ours: truth = estimate·Exp(ξ), ξ = (translation, rotation) in axes of the moving frame. ROS: errors along and about
    the fixed axes of the parent frame. To first order t' = t + R ρ and R' = R·Exp(ω) = Exp(R ω)·R, so
    Σ_ros = B Σ Bᵀ with B = diag(R, R): each half is rotated, without a lever arm.
    """
    b = np.zeros((6, 6))
    b[:3, :3] = b[3:, 3:] = rotation
    return _carried(b, cov_pose)


def _carried(by: Array, cov: Array) -> Array:
    """Return a covariance (6, 6) transformed by a matrix (6, 6); NaN if it is not finite."""
    return by @ cov @ by.T if np.isfinite(cov).all() else np.full((6, 6), np.nan)


class RosFrames:
    """Transforms poses, covariances and points into the frames that the settings name.

    `fixed_from_world` (4, 4): the axes of the settings; `base_from_cam` (4, 4): the camera on the robot, if there
    is one.
    """

    def __init__(self, ros: RosConfig) -> None:
        self.world, self.odom, self.camera = ros.world_frame, ros.odom_frame, ros.camera_frame
        self.moving = ros.base_frame or ros.camera_frame
        self.base_from_cam = _base_from_cam(ros) if ros.base_frame else None
        own: Array = np.eye(4) if self.base_from_cam is None else self.base_from_cam
        self.fixed_from_world = BODY_FROM_CAMERA_AXES if (ros.z_up or ros.gravity) and not ros.base_frame else own
        self._world_from_fixed, self._cam_from_moving = se3.inverse(self.fixed_from_world), se3.inverse(own)
        # W·Exp(ξ) in the base: B·W·Exp(ξ)·B⁻¹ = (B·W·B⁻¹)·Exp(Ad(B) ξ).
        self._carries = se3.adjoint(own)

    def pose(self, world_from_cam: Array) -> Array:
        """Return the pose (4, 4) of the moving frame, base or camera, in the fixed frame, world or odom."""
        return np.asarray(self.fixed_from_world @ world_from_cam @ self._cam_from_moving)

    def pose_of_camera(self, fixed_from_moving: Array) -> Array:
        """Return world_from_cam (4, 4) for a pose of the moving frame in the fixed one; the inverse of `pose`."""
        return np.asarray(self._world_from_fixed @ fixed_from_moving @ se3.inverse(self._cam_from_moving))

    def between(self, world_from_odom: Array) -> Array:
        """Return the pose (4, 4) of the odom frame in that of the world, both with the axes of the settings."""
        return np.asarray(self.fixed_from_world @ world_from_odom @ self._world_from_fixed)

    def twist(self, twist: Array) -> Array:
        """Return the twist (6,) of the moving frame in its own axes from that of the camera in its axes."""
        return np.asarray(self._carries @ twist)

    def cov_pose(self, cov_pose: Array) -> Array:
        """Return the covariance (6, 6) of a pose or twist, translation first, in axes of the moving frame."""
        return _carried(self._carries, cov_pose)

    def points(self, points_in_world: Array, cov_points: Array) -> tuple[Array, Array]:
        """Return points (n, 3) of the world and their covariances (n, 3, 3) in the fixed frame."""
        turned = self.fixed_from_world[:3, :3]
        return se3.transform(self.fixed_from_world, points_in_world), turned @ cov_points @ turned.T


def _base_from_cam(ros: RosConfig) -> Array:
    angles = np.radians([ros.camera_roll_deg, ros.camera_pitch_deg, ros.camera_yaw_deg])
    about_x, about_y, about_z = (se3.exp_so3(a * axis) for a, axis in zip(angles, np.eye(3), strict=True))
    place = [ros.camera_x_m, ros.camera_y_m, ros.camera_z_m]
    mounted = se3.from_rotation_translation(about_z @ about_y @ about_x, place)
    return mounted @ BODY_FROM_CAMERA_AXES
