"""Depths from the motion of one camera: each point lies on its ray in the frame where its template was cut."""

import numpy as np

from ...geometry import Array, se3
from ...geometry.stereo import MIN_DEPTH, StereoProjection
from ..tracks import Tracks


def update_by_parallax(
    p: StereoProjection, tracks: Tracks, z_px: Array, cov_px: Array, cam_from_start: Array, forgetting: float
) -> Tracks:
    """Return the tracks at the positions of their views, with 1/Z by a scalar Kalman update in the anchor camera.

    There the parallax of all frames since then adds up. The variance is multiplied by `forgetting` first. With
    Z(ρ) = (R a)₃ + t₃ ρ, a point of inverse depth ρ there has ρ/Z here.
    """
    now_from_anchor = cam_from_start @ se3.inverse(tracks.anchor_from_start)
    rays = p.rays(z_px)
    cov_rays = cov_px[:, :2, :2] / p.f_px**2
    seen, var_seen = depths_from_motion(now_from_anchor, tracks.anchor_rays, rays, cov_rays)
    far = np.maximum(directions(now_from_anchor, tracks.anchor_rays)[:, 2], MIN_DEPTH)
    t = now_from_anchor[:, 2, 3]
    rho = tracks.points[:, 3] * far / np.maximum(1 - t * tracks.points[:, 3], MIN_DEPTH)
    before = forgetting * tracks.var_rho * (np.maximum(far + t * rho, MIN_DEPTH) ** 2 / far) ** 2
    gain = before / (before + var_seen)
    rho = rho + gain * (seen - rho)
    depth = np.maximum(far + t * rho, MIN_DEPTH)
    var_rho = (1 - gain) * before * (far / depth**2) ** 2
    return tracks.placed(rays, z_px[:, :2], cov_px[:, :2, :2], rho / depth, var_rho)


def depths_from_motion(
    now_from_anchor: Array, rays_anchor: Array, rays_now: Array, cov_rays: Array
) -> tuple[Array, Array]:
    """Return inverse depths (n,) in the anchor camera from rays (n, 2) there and now, and their variances (n,).

    Eq. (65): x (R a + t ρ)₃ = (R a + t ρ)₁₂ is linear in ρ. Poses are (4, 4) or (n, 4, 4), and `cov_rays`, of the
    current rays, (n, 2, 2) or (2, 2).
    """
    far = directions(now_from_anchor, rays_anchor)
    t = now_from_anchor[..., :3, 3]
    along = t[..., :2] - rays_now * t[..., 2:]
    offset = rays_now * far[:, 2:] - far[:, :2]
    weighted = np.linalg.solve(cov_rays, along[..., None])[..., 0]
    information = np.maximum((weighted * along).sum(1), 1e-12)  # finite variance without parallax
    return (weighted * offset).sum(1) / information, far[:, 2] ** 2 / information


def directions(now_from_anchor: Array, rays_anchor: Array) -> Array:
    """Return R a (n, 3), the directions of rays (n, 2) in the current camera, at unit depth in their own."""
    a = np.concatenate([rays_anchor, np.ones((len(rays_anchor), 1))], axis=1)
    return np.asarray((now_from_anchor[..., :3, :3] @ a[..., None])[..., 0])
