"""The covariance of a pose as ROS writes it.

Ours: truth = estimate·Exp(ξ), ξ = (translation, rotation) in axes of the moving frame. ROS (REP 103): position and
rotation errors along the fixed axes of the parent frame, x y z then rotation about x, y, z, row-major. To first
order t' = t + R ρ and R' = R·Exp(ω) = Exp(R ω)·R, so Σ_ros = B Σ Bᵀ with B = diag(R, R): each half is rotated,
no lever arm enters.
"""

import numpy as np

from ..geometry.se3 import Array


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
