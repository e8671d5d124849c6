"""A world with its z axis upwards, from gravity as measured by inertial samples."""

import numpy as np

from ..geometry import Array, se3
from ..geometry.linear import symmetric
from ..record import record

# Columns: the camera's right, down and forward in the axes of a body, REP 103: x forward, y left, z up.
BODY_FROM_CAMERA_AXES = se3.from_rotation_translation([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0, 0, 0])


@record
class Upright:
    """The pose of a frame's world in an upright world, from gravity as estimated in that frame.

    `upright_from_world` (4, 4): a rotation about the origin of the upright world, by the smallest angle, so that the
    heading stays; `cov` (6, 6): of the perturbation on its right. `cov_pose` (6, 6): of the frame's own pose in the
    upright world; its tilt is as certain as gravity in the camera, even if the world has drifted.
    """

    upright_from_world: Array
    cov: Array
    cov_pose: Array

    @classmethod
    def of(
        cls, world_from_cam: Array, gravity: Array, joint: Array, fixed_from_world: Array = BODY_FROM_CAMERA_AXES
    ) -> "Upright":
        """Return it from a pose (4, 4), gravity (3,) in the camera and their joint covariance (9, 9), pose first.

        `fixed_from_world` (4, 4): the origin, and the axes that would be upright if the world were level.
        """
        size = float(np.linalg.norm(gravity))
        down, r = gravity / size, world_from_cam[:3, :3]
        up = -r @ down
        # δup = R [down]× δω − R (1 − down downᵀ) δg/|g|, and the rotation of the world by it is −up × δup.
        across = (np.eye(3) - np.outer(down, down)) / size
        turn_by = np.concatenate([np.zeros((3, 3)), r @ se3.skew(down), -r @ across], axis=1)
        by = np.zeros((6, 9))
        by[3:] = -se3.skew(up) @ turn_by
        axes = fixed_from_world[:3, :3]
        by[3:] = axes @ by[3:]
        by = se3.adjoint(se3.inverse(fixed_from_world)) @ by
        of_pose = np.eye(6, 9) + se3.adjoint(se3.inverse(world_from_cam)) @ by
        level = se3.from_rotation_translation(_least_turn(axes @ up), np.zeros(3))
        return cls(
            se3.orthonormalise(level @ fixed_from_world),
            symmetric(by @ joint @ by.T),
            symmetric(of_pose @ joint @ of_pose.T),
        )

    def poses(self, world_from_cam: Array, cov_pose: Array) -> tuple[Array, Array]:
        """Return poses (n, 4, 4) of the world, and their covariances (n, 6, 6), in the upright world.

        The error of the upward direction is treated as independent. In fact an error of a pose's tilt in the world also
        affects that direction, with the opposite sign, so σ of the tilt is an upper bound.
        """
        to_cam = se3.adjoint(se3.inverse(world_from_cam))
        cov = cov_pose + to_cam @ self.cov @ np.swapaxes(to_cam, 1, 2)
        return se3.orthonormalise(self.upright_from_world @ world_from_cam), cov

    @property
    def std_tilt_rad(self) -> float:
        """σ of the upward direction in the world, the larger of two."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.cov[3:, 3:])[-1], 0.0)))

    def __repr__(self) -> str:
        return f"<Upright, tilt ±{1e3 * self.std_tilt_rad:.1f} mrad>"


def _least_turn(up: Array) -> Array:
    """Return the rotation (3, 3) by the smallest angle that takes a unit vector (3,) to z."""
    sine = np.array([up[1], -up[0], 0.0])  # up × z
    length = float(np.linalg.norm(sine))
    if length < 1e-12:
        return np.eye(3) if up[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return se3.exp_so3(sine / length * np.arctan2(length, up[2]))
