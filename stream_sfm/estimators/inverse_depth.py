"""Points as q = (X/Z, Y/Z, 1/Z) in the camera that first saw them, and the linearised stereo views of many frames.

In this chart a stereo view is nearly linear, so a Gaussian over q stays honest for far points, a point at infinity
is an ordinary one, and a point beside or behind today's camera stays one too. Homogeneous points in the reference
camera are C (q₁, q₂, 1, q₃)ᵀ, with C = ref_from_chart a known pose, a choice of coordinates and no part of the
state; a frame s with pose X_s = cam_s_from_ref sees P = X_s C (q₁, q₂, 1, q₃)ᵀ. A pose moves as Exp(ξ) X_s (left),
which is the right perturbation −ξ of ref_from_cam_s. All arrays are batched: F frames, P points, no loops.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry import pose as se3
from ..geometry.pose import Array
from ..geometry.stereo import StereoProjection

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
    """G = ∂P/∂ξ (…, 4, 6) of Exp(ξ)·P at homogeneous points P (…, 4)."""
    g = np.zeros((*points.shape[:-1], 4, 6))
    g[..., 0, 0] = g[..., 1, 1] = g[..., 2, 2] = points[..., 3]
    g[..., :3, 3:] = -se3.skew(points[..., :3])
    return g


def metric_jacobian(points: Array) -> Array:
    """∂X/∂P (…, 3, 4) of the metric point X = P₁..₃/ρ at homogeneous points (…, 4)."""
    j = np.zeros((*points.shape[:-1], 3, 4))
    inv = 1 / points[..., 3]
    j[..., 0, 0] = j[..., 1, 1] = j[..., 2, 2] = inv
    j[..., :, 3] = -points[..., :3] * (inv * inv)[..., None]
    return j


@dataclass(frozen=True, slots=True)
class Linearised:
    """Normal equations of all views: pose blocks `u` (F, 6, 6), point blocks `v` (P, 3, 3), cross blocks `c`
    (F, P, 6, 3), right-hand sides `g_pose` (F, 6), `g_point` (P, 3), and each view's squared norm `chi2` (F, P)."""

    u: Array
    v: Array
    c: Array
    g_pose: Array
    g_point: Array
    chi2: Array


def view_residuals(
    projection: StereoProjection, cams_from_ref: Array, charts: Array, q: Array, z: Array, info: Array
) -> tuple[Array, Array, Array]:
    """In-camera homogeneous points (F, P, 4), residuals (F, P, 4), squared norms (F, P); unseen views give 0.

    `z` (F, P, 4) holds any number where `info` (F, P, 4, 4) is zero; it must be finite.
    """
    in_cam = in_reference(charts, q)[None] @ np.swapaxes(cams_from_ref, 1, 2)
    behind = in_cam[..., 2] < MIN_DEPTH
    in_cam[..., 2] = np.where(behind, MIN_DEPTH, in_cam[..., 2])
    r = z - projection.project_homogeneous(in_cam)
    chi2 = (r * (info @ r[..., None])[..., 0]).sum(-1)
    return in_cam, r, chi2


def linearise(
    projection: StereoProjection, cams_from_ref: Array, charts: Array, q: Array, z: Array, info: Array
) -> Linearised:
    """Gauss-Newton normal equations of all views (Schur form of bundle adjustment, Triggs et al. 2000, sec. 6)."""
    in_cam, r, chi2 = view_residuals(projection, cams_from_ref, charts, q, z, info)
    a = projection.jacobian_homogeneous(in_cam)
    aw = np.swapaxes(a, -1, -2) @ info
    n = aw @ a
    g = (aw @ r[..., None])[..., 0]
    gp = pose_jacobian(in_cam)
    m = cams_from_ref[:, None] @ charts[:, :, CHART]
    ngm = n @ m
    gpt = np.swapaxes(gp, -1, -2)
    mt = np.swapaxes(m, -1, -2)
    return Linearised(
        u=(gpt @ n @ gp).sum(1),
        v=(mt @ ngm).sum(0),
        c=gpt @ ngm,
        g_pose=(gpt @ g[..., None]).sum(1)[..., 0],
        g_point=(mt @ g[..., None]).sum(0)[..., 0],
        chi2=chi2,
    )


def gradients(
    projection: StereoProjection, cams_from_ref: Array, charts: Array, q: Array, z: Array, info: Array
) -> tuple[Array, Array]:
    """Only the right-hand sides of `linearise`: for poses (F, 6) and points (P, 3)."""
    in_cam, r, _ = view_residuals(projection, cams_from_ref, charts, q, z, info)
    aw = np.swapaxes(projection.jacobian_homogeneous(in_cam), -1, -2) @ info
    g = aw @ r[..., None]
    g_pose = (np.swapaxes(pose_jacobian(in_cam), -1, -2) @ g).sum(1)[..., 0]
    in_ref = (np.swapaxes(cams_from_ref, 1, 2)[:, None] @ g).sum(0)
    return g_pose, (np.swapaxes(charts[:, :, CHART], 1, 2) @ in_ref)[..., 0]
