"""Rigid motions as 4×4 arrays, with tangent ξ = (translation, rotation), T ⊞ ξ = T·Exp(ξ).

Formulas: Barfoot, State Estimation for Robotics, 2nd ed., sections 8.1 and 8.2. All functions take stacked
arrays (leading axes broadcast) and return float64.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import core

Array = NDArray[np.float64]

_EYE = np.eye(3)


def skew(v: ArrayLike) -> Array:
    """Return [v]× (…, 3, 3) of vectors (…, 3): skew(a) @ b = a × b."""
    v = np.asarray(v, dtype=float)
    m = np.zeros((*v.shape[:-1], 3, 3))
    m[..., 0, 1], m[..., 0, 2] = -v[..., 2], v[..., 1]
    m[..., 1, 0], m[..., 1, 2] = v[..., 2], -v[..., 0]
    m[..., 2, 0], m[..., 2, 1] = -v[..., 1], v[..., 0]
    return m


def exp_so3(rotation: ArrayLike) -> Array:
    """Return the rotation matrix (…, 3, 3) of a rotation vector (…, 3) in radians."""
    w = np.asarray(rotation, dtype=float)
    return exp(np.concatenate([np.zeros_like(w), w], axis=-1))[..., :3, :3]


def log_so3(rotation_matrix: ArrayLike) -> Array:
    """Return the rotation vector (…, 3) rad, norm ≤ π, of rotation matrices (…, 3, 3). Valid at 0 and π."""
    r = np.asarray(rotation_matrix, dtype=float)
    return core.rotation_vectors(r.reshape(-1, 3, 3)).reshape(*r.shape[:-2], 3)


def exp(xi: ArrayLike) -> Array:
    """Return the poses (…, 4, 4) Exp(ξ) of tangents (…, 6) = (translation, rotation), eq. (3) (Barfoot, eq. 8.33)."""
    xi = np.asarray(xi, dtype=float)
    return core.pose_exp(xi.reshape(-1, 6)).reshape(*xi.shape[:-1], 4, 4)


def log(pose: ArrayLike) -> Array:
    """Return the tangents (…, 6) = (translation, rotation) of poses (…, 4, 4); the inverse of `exp`."""
    pose = np.asarray(pose, dtype=float)
    return core.pose_log(pose.reshape(-1, 4, 4)).reshape(*pose.shape[:-2], 6)


def log_jacobian(xi: Array) -> Array:
    """Return ∂Log(Exp(ξ)·Exp(δ))/∂δ (6, 6) at δ = 0 of a tangent (6,), to 0.2 % up to 1 rad (Barfoot, eq. 8.99)."""
    ad = np.zeros((6, 6))
    ad[:3, :3] = ad[3:, 3:] = skew(xi[3:])
    ad[:3, 3:] = skew(xi[:3])
    return np.asarray(np.eye(6) + ad / 2 + ad @ ad / 12)


def from_rotation_translation(rotation: ArrayLike, translation: ArrayLike) -> Array:
    """Return the pose (…, 4, 4) of rotation matrices (…, 3, 3) and translations (…, 3)."""
    rotation = np.asarray(rotation, dtype=float)
    translation = np.asarray(translation, dtype=float)
    shape = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    pose = np.zeros((*shape, 4, 4))
    pose[..., :3, :3], pose[..., :3, 3], pose[..., 3, 3] = rotation, translation, 1.0
    return pose


def inverse(pose: ArrayLike) -> Array:
    """Return the inverse of rigid motions (…, 4, 4)."""
    pose = np.asarray(pose, dtype=float)
    return core.pose_inverse(pose.reshape(-1, 4, 4)).reshape(pose.shape)


def adjoint(pose: ArrayLike) -> Array:
    """Return Ad(T) (…, 6, 6) of poses (…, 4, 4): T·Exp(ξ)·T⁻¹ = Exp(Ad(T) ξ), eq. (4) (Barfoot, eq. 8.40)."""
    pose = np.asarray(pose, dtype=float)
    return core.pose_adjoint(pose.reshape(-1, 4, 4)).reshape(*pose.shape[:-2], 6, 6)


def transform(target_from_source: ArrayLike, points_in_source: ArrayLike) -> Array:
    """Return points (…, n, 3) carried by a pose (…, 4, 4)."""
    pose = np.asarray(target_from_source, dtype=float)
    points: Array = np.asarray(points_in_source) @ np.swapaxes(pose[..., :3, :3], -1, -2) + pose[..., None, :3, 3]
    return points


def point_in_source_jacobian(points_in_source: Array) -> Array:
    """Return ∂X_source/∂ξ (…, 3, 6) = [−I, [X_source]×] of points fixed in the target frame, eq. (45).

    ξ is the right perturbation of target_from_source.
    """
    jacobian: Array = np.empty((*points_in_source.shape, 6))
    jacobian[..., :3], jacobian[..., 3:] = -_EYE, skew(points_in_source)
    return jacobian


ROUNDED = 1e-2  # deviation of R Rᵀ from the identity if poses were written with three digits


def is_rotation(matrices: ArrayLike, tolerance: float = 1e-3) -> NDArray[np.bool_]:
    """Return whether matrices (…, 3, 3) are rotations, R Rᵀ = I within a tolerance: files may have only four digits."""
    r = np.asarray(matrices, dtype=float)
    off = np.abs(r @ np.swapaxes(r, -1, -2) - _EYE)
    return np.asarray((off < tolerance).all(axis=(-2, -1)) & (np.linalg.det(r) > 0))


def orthonormalise(pose: ArrayLike) -> Array:
    """Return the pose with its approximate rotation projected back onto SO(3).

    Compositions need it: a constant-velocity prediction multiplies the loss of orthonormality by 2.4 per frame.
    Newton-Schulz iteration to the polar factor: an error of 10⁻³ is below 10⁻¹² after two steps (Higham, Functions of
    Matrices, section 8.3).
    """
    pose = np.asarray(pose, dtype=float)
    return core.orthonormalise(pose.reshape(-1, 4, 4)).reshape(pose.shape)


def quat_xyzw_from_matrix(rotation_matrix: ArrayLike) -> Array:
    """Return unit quaternions (…, 4) in the order x, y, z, w, with w ≥ 0, of rotation matrices (…, 3, 3)."""
    r = np.asarray(rotation_matrix, dtype=float)
    return core.quaternions(r.reshape(-1, 3, 3)).reshape(*r.shape[:-2], 4)


def matrix_from_quat_xyzw(quat_xyzw: ArrayLike) -> Array:
    """Return rotation matrices (…, 3, 3) of quaternions (…, 4) in the order x, y, z, w, of any non-zero norm."""
    q = np.asarray(quat_xyzw, dtype=float)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    k = skew(q[..., :3])
    rotation: Array = _EYE + 2 * q[..., 3, None, None] * k + 2 * (k @ k)
    return rotation


# `stream_sfm` exports them under these names, which do not need the name of this module.
se3_adjoint, se3_exp, se3_inverse, se3_log = adjoint, exp, inverse, log
