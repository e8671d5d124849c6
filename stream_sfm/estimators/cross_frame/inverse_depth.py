"""Points as q = (X/Z, Y/Z, 1/Z) in the camera that first saw them, and the linearised stereo views of many frames.

In this chart a stereo view is nearly linear, so a Gaussian over q stays honest for far points, a point at infinity
is an ordinary one, and a point beside or behind today's camera stays one too. Homogeneous points in the reference
camera are C (q₁, q₂, 1, q₃)ᵀ, with C = ref_from_chart, eq. (24), a known pose, a choice of coordinates and no part of
the state; a frame s with pose X_s = cam_s_from_ref sees P = X_s C (q₁, q₂, 1, q₃)ᵀ. A pose moves as Exp(ξ) X_s
(left), which is the right perturbation −ξ of ref_from_cam_s. Arrays are batched: F frames, P points, V views.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ...geometry import se3
from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection

CHART = np.array([0, 1, 3])  # columns of a homogeneous point that q moves
MIN_DEPTH = 1e-3


def homogeneous_from_q(q: Array) -> Array:
    """(…, 4) from (…, 3)."""
    return np.stack([q[..., 0], q[..., 1], np.ones(q.shape[:-1]), q[..., 2]], axis=-1)


def in_reference(charts: Array, q: Array) -> Array:
    """Homogeneous points (P, 4) in the reference camera of q (P, 3) in charts ref_from_chart (P, 4, 4)."""
    return (charts @ homogeneous_from_q(q)[..., None])[..., 0]


def q_from_homogeneous(points: Array) -> Array:
    """(…, 3) from homogeneous (…, 4) with Z > 0."""
    return points[..., [0, 1, 3]] / points[..., 2:3]


def q_jacobian(points: Array) -> Array:
    """∂q/∂P (…, 3, 4) at homogeneous points (…, 4)."""
    k = np.zeros((*points.shape[:-1], 3, 4))
    inv = 1 / points[..., 2]
    k[..., 0, 0] = k[..., 1, 1] = k[..., 2, 3] = inv
    k[..., :, 2] = -points[..., [0, 1, 3]] * (inv * inv)[..., None]
    return k


def pose_jacobian(points: Array) -> Array:
    """G = ∂P/∂ξ (…, 4, 6) of Exp(ξ)·P at homogeneous points P (…, 4), eq. (21)."""
    g = np.zeros((*points.shape[:-1], 4, 6))
    g[..., 0, 0] = g[..., 1, 1] = g[..., 2, 2] = points[..., 3]
    g[..., :3, 3:] = -se3.skew(points[..., :3])
    return g


def metric_jacobian(points: Array) -> Array:
    """∂X/∂P (…, 3, 4) of the metric point X = P₁..₃/ρ at homogeneous points (…, 4), eq. (38)."""
    j = np.zeros((*points.shape[:-1], 3, 4))
    inv = 1 / points[..., 3]
    j[..., 0, 0] = j[..., 1, 1] = j[..., 2, 2] = inv
    j[..., :, 3] = -points[..., :3] * (inv * inv)[..., None]
    return j


@dataclass(frozen=True, slots=True)
class Views:
    """The views of a window, flat: `frame` (V,) and `point` (V,) indices from 0, each pair at most once; `z` (V, 4)
    finite; `root` (V, 4, 4) whitens a residual, RᵀR the view's information, zero rows for a side that is missing."""

    frame: NDArray[np.intp]
    point: NDArray[np.intp]
    z: Array
    root: Array

    @classmethod
    def none(cls) -> "Views":
        """No views."""
        return cls(np.empty(0, np.intp), np.empty(0, np.intp), np.empty((0, 4)), np.empty((0, 4, 4)))

    @classmethod
    def joined(cls, parts: Sequence["Views"]) -> "Views":
        """The views of several frames."""
        return cls(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)))


@dataclass(frozen=True, slots=True)
class Linearised:
    """Normal equations of all views: pose blocks `u` (F, 6, 6), point blocks `v` (P, 3, 3), cross blocks `c`
    (P, 3, 6F), right-hand sides `g_pose` (F, 6), `g_point` (P, 3)."""

    u: Array
    v: Array
    c: Array
    g_pose: Array
    g_point: Array


def whitened_residuals(
    projection: StereoProjection, cams_from_ref: Array, charts: Array, q: Array, views: Views
) -> tuple[Array, Array]:
    """In-camera homogeneous points and whitened residuals, (V, 4); poses (F, 4, 4), charts (P, 4, 4), q (P, 3)."""
    in_ref = in_reference(charts, q)[views.point]
    in_cam = (cams_from_ref[views.frame] @ in_ref[..., None])[..., 0]
    np.maximum(in_cam[:, 2], MIN_DEPTH, out=in_cam[:, 2])
    r = views.z - projection.project_homogeneous(in_cam)
    return in_cam, (views.root @ r[..., None])[..., 0]


def linearise(
    projection: StereoProjection, cams_from_ref: Array, charts: Array, q: Array, views: Views
) -> Linearised:
    """Gauss-Newton normal equations of all views, eqs. (25) and (26)."""
    frames, points = len(cams_from_ref), len(q)
    in_cam, r = whitened_residuals(projection, cams_from_ref, charts, q, views)
    by_cam = views.root @ projection.jacobian_homogeneous(in_cam)
    j = np.empty((len(r), 4, 10))  # whitened: derivatives by the pose (6), by the point (3), and the residual
    j[..., :6] = by_cam @ pose_jacobian(in_cam)
    j[..., 6:9] = (by_cam @ cams_from_ref[views.frame]) @ charts[:, :, CHART].take(views.point, axis=0)
    j[..., 9] = r
    products = np.swapaxes(j[..., :9], 1, 2) @ j
    of_frame = np.zeros((frames, len(r)))
    of_frame[views.frame, np.arange(len(r))] = 1.0
    by_frame = (of_frame @ products.reshape(len(r), 90)).reshape(frames, 9, 10)
    by_point = np.zeros((frames, points, 3, 4))
    by_point[views.frame, views.point] = products[:, 6:, 6:]
    by_point = by_point.sum(0)
    c = np.zeros((points, 3, frames, 6))
    c[views.point, :, views.frame] = products[:, 6:, :6]
    return Linearised(
        u=by_frame[:, :6, :6],
        v=by_point[..., :3],
        c=c.reshape(points, 3, 6 * frames),
        g_pose=by_frame[:, :6, 9],
        g_point=by_point[..., 3],
    )
