"""Rigid motions as 4×4 arrays, with tangent ξ = (translation, rotation), T ⊞ ξ = T·Exp(ξ).

Formulas: Barfoot, State Estimation for Robotics, 2nd ed., sections 8.1 and 8.2. All functions take stacked
arrays (leading axes broadcast) and return float64.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_EYE = np.eye(3)
_LEAST_ANGLE = 1e-150  # rad, in place of 0 where an angle divides: its square is still a normal double
# A linearised rotation is off by a few per cent there; longer steps of an iteration keep their direction.
MAX_ROTATION_STEP_RAD = 0.3
_SMALL = 1e-4  # sine of half an angle; closed form: the next term of the series, n⁴/5, is below a double's rounding


def skew(v: ArrayLike) -> Array:
    """Return [v]× (…, 3, 3) of vectors (…, 3): skew(a) @ b = a × b."""
    v = np.asarray(v, dtype=float)
    m = np.zeros((*v.shape[:-1], 3, 3))
    m[..., 0, 1], m[..., 0, 2] = -v[..., 2], v[..., 1]
    m[..., 1, 0], m[..., 1, 2] = v[..., 2], -v[..., 0]
    m[..., 2, 0], m[..., 2, 1] = -v[..., 1], v[..., 0]
    return m


def _coefficients(angle: Array) -> tuple[Array, Array, Array]:
    """Return sin θ/θ, (1−cos θ)/θ² and (θ−sin θ)/θ³ of angles θ ≥ 0.

    The last one loses digits as θ² falls, but it always multiplies a product of that size.
    """
    a = np.maximum(angle, _LEAST_ANGLE)
    sine, half = np.sin(a) / a, np.sin(a / 2) / a
    return sine, 2 * half * half, (1 - sine) / (a * a)  # 1 − cos θ = 2 sin²(θ/2) without cancellation


def exp_so3(rotation: ArrayLike) -> Array:
    """Return the rotation matrix (…, 3, 3) of a rotation vector (…, 3) in radians."""
    w = np.asarray(rotation, dtype=float)
    a, b, _ = _coefficients(np.linalg.norm(w, axis=-1))
    k = skew(w)
    return _EYE + a[..., None, None] * k + b[..., None, None] * (k @ k)


def log_so3(rotation_matrix: ArrayLike) -> Array:
    """Return the rotation vector (…, 3) rad, norm ≤ π, of rotation matrices (…, 3, 3). Valid at 0 and π."""
    return _vector_from_quat(quat_xyzw_from_matrix(rotation_matrix))


def _vector_from_quat(q: Array) -> Array:
    q = np.where(q[..., 3:] < 0, -q, q)
    n = np.linalg.norm(q[..., :3], axis=-1)
    small = n < _SMALL
    angle = 2 * np.arctan2(n, q[..., 3])
    w = np.where(small, q[..., 3], 1.0)
    scale = np.where(small, 2 / w * (1 - (n / w) ** 2 / 3), angle / np.where(small, 1.0, n))
    rotation: Array = scale[..., None] * q[..., :3]
    return rotation


def _left_jacobian(w: Array) -> Array:
    """Return V(ω) (…, 3, 3) with t = V ρ in Exp(ρ, ω), eq. (3) (Barfoot, eq. 8.33)."""
    _, b, c = _coefficients(np.linalg.norm(w, axis=-1))
    k = skew(w)
    return _EYE + b[..., None, None] * k + c[..., None, None] * (k @ k)


def exp(xi: ArrayLike) -> Array:
    """Return the poses (…, 4, 4) Exp(ξ) of tangents (…, 6) = (translation, rotation), eq. (3) (Barfoot, eq. 8.33)."""
    xi = np.asarray(xi, dtype=float)
    if xi.ndim == 1:
        return _exp_of_one(xi)
    m = np.zeros((*xi.shape[:-1], 4, 4))
    m[..., :3, :3], m[..., :3, 3] = skew(xi[..., 3:]), xi[..., :3]
    m2 = m @ m
    _, b, c = _coefficients(np.sqrt((xi[..., 3:] ** 2).sum(axis=-1)))
    pose: Array = np.eye(4) + m + b[..., None, None] * m2 + c[..., None, None] * (m2 @ m)
    return pose


def _exp_of_one(xi: Array) -> Array:
    """`exp` of one tangent (6,), written out: NumPy on so few numbers takes five times as long."""
    x, y, z, a, b, c = xi.tolist()
    angle = max(math.sqrt(a * a + b * b + c * c), _LEAST_ANGLE)
    sine, half = math.sin(angle) / angle, math.sin(angle / 2) / angle
    p, q = 2 * half * half, (1 - sine) / (angle * angle)
    u, v, w = b * z - c * y, c * x - a * z, a * y - b * x  # ω × ρ
    return np.array(
        [
            [1 - p * (b * b + c * c), p * a * b - sine * c, p * a * c + sine * b, x + p * u + q * (b * w - c * v)],
            [p * a * b + sine * c, 1 - p * (a * a + c * c), p * b * c - sine * a, y + p * v + q * (c * u - a * w)],
            [p * a * c - sine * b, p * b * c + sine * a, 1 - p * (a * a + b * b), z + p * w + q * (a * v - b * u)],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def log(pose: ArrayLike) -> Array:
    """Return the tangents (…, 6) = (translation, rotation) of poses (…, 4, 4); the inverse of `exp`."""
    pose = np.asarray(pose, dtype=float)
    w = log_so3(pose[..., :3, :3])
    rho = np.linalg.solve(_left_jacobian(w), pose[..., :3, 3:])[..., 0]
    return np.concatenate([rho, w], axis=-1)


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
    r_t = np.swapaxes(pose[..., :3, :3], -1, -2)
    return from_rotation_translation(r_t, -(r_t @ pose[..., :3, 3:])[..., 0])


def adjoint(pose: ArrayLike) -> Array:
    """Return Ad(T) (…, 6, 6) of poses (…, 4, 4): T·Exp(ξ)·T⁻¹ = Exp(Ad(T) ξ), eq. (4) (Barfoot, eq. 8.40)."""
    pose = np.asarray(pose, dtype=float)
    r, t = pose[..., :3, :3], pose[..., :3, 3]
    ad = np.zeros((*pose.shape[:-2], 6, 6))
    ad[..., :3, :3] = ad[..., 3:, 3:] = r
    ad[..., :3, 3:] = skew(t) @ r
    return ad


def transform(target_from_source: ArrayLike, points_in_source: ArrayLike) -> Array:
    """Return points (…, n, 3) carried by a pose (…, 4, 4)."""
    pose = np.asarray(target_from_source, dtype=float)
    points: Array = np.asarray(points_in_source) @ np.swapaxes(pose[..., :3, :3], -1, -2) + pose[..., None, :3, 3]
    return points


def point_in_source_jacobian(points_in_source: Array) -> Array:
    """Return ∂X_source/∂ξ (…, 3, 6) = [−I, [X_source]×] of points fixed in the target frame, eq. (45).

    ξ is the right perturbation of target_from_source.
    """
    minus_eye = np.broadcast_to(-_EYE, (*points_in_source.shape, 3))
    return np.concatenate([minus_eye, skew(points_in_source)], axis=-1)


def orthonormalise(pose: ArrayLike) -> Array:
    """Return the pose with its rotation, which is nearly one, projected back onto SO(3).

    Compositions need it: a constant-velocity prediction multiplies the loss of orthonormality by 2.4 per frame.
    Newton-Schulz iteration to the polar factor: an error of 10⁻³ is below 10⁻¹² after two steps (Higham, Functions of
    Matrices, section 8.3).
    """
    pose = np.array(pose, dtype=float)
    r = pose[..., :3, :3]
    for _ in range(2):
        r = r @ (1.5 * _EYE - 0.5 * (np.swapaxes(r, -1, -2) @ r))
    pose[..., :3, :3] = r
    return pose


def quat_xyzw_from_matrix(rotation_matrix: ArrayLike) -> Array:
    """Return unit quaternions (…, 4) in the order x, y, z, w, with w ≥ 0, of rotation matrices (…, 3, 3)."""
    r = np.asarray(rotation_matrix, dtype=float)
    if r.ndim == 2:
        return _quat_of_one(r)
    trace = r[..., 0, 0] + r[..., 1, 1] + r[..., 2, 2]
    # The 4×4 symmetric matrix 4·q·qᵀ: its row with the largest diagonal is the best conditioned.
    q2 = np.empty((*r.shape[:-2], 4, 4))
    for i in range(3):
        q2[..., i, i] = 1 + 2 * r[..., i, i] - trace
        j, k = (i + 1) % 3, (i + 2) % 3
        q2[..., i, j] = q2[..., j, i] = r[..., i, j] + r[..., j, i]
        q2[..., i, 3] = q2[..., 3, i] = r[..., k, j] - r[..., j, k]
    q2[..., 3, 3] = 1 + trace
    best = np.argmax(np.diagonal(q2, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(q2, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    positive: Array = np.where(q[..., 3:] < 0, -q, q)
    return positive


def _quat_of_one(rotation: Array) -> Array:
    """`quat_xyzw_from_matrix` of one matrix (3, 3), written out: NumPy on so few numbers takes ten times as long."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    rows = (
        (1 + a - e - i, b + d, c + g, h - f),
        (b + d, 1 - a + e - i, f + h, c - g),
        (c + g, f + h, 1 - a - e + i, d - b),
        (h - f, c - g, d - b, 1 + a + e + i),
    )
    q = rows[max(range(4), key=lambda k: rows[k][k])]
    norm = math.copysign(math.hypot(*q), q[3])
    return np.array([x / norm for x in q])


def matrix_from_quat_xyzw(quat_xyzw: ArrayLike) -> Array:
    """Return rotation matrices (…, 3, 3) of quaternions (…, 4) in the order x, y, z, w, of any non-zero norm."""
    q = np.asarray(quat_xyzw, dtype=float)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    k = skew(q[..., :3])
    rotation: Array = _EYE + 2 * q[..., 3, None, None] * k + 2 * (k @ k)
    return rotation
