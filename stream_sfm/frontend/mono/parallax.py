"""Depths from the motion of one camera: each point on the ray of the frame where its template was cut."""

import numpy as np

from ...geometry import Array, se3
from ...geometry.stereo import MIN_DEPTH, StereoProjection
from ..tracks import Tracks


def update_by_parallax(
    p: StereoProjection, tracks: Tracks, z_px: Array, cov_px: Array, cam_from_start: Array, forgetting: float
) -> Tracks:
    """Tracks put where they were seen; 1/Z by a scalar Kalman update in the anchor camera, where the parallax of
    all frames since adds up, and its variance grows by `forgetting`.

    With Z(ρ) = (R a)₃ + t₃ ρ, a point of inverse depth ρ there has ρ/Z here.
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
    """Inverse depths (n,) in the anchor camera from where its rays (n, 2) are seen now, and their variances.

    Eq. (65): x (R a + t ρ)₃ = (R a + t ρ)₁₂ is linear in ρ. Poses (4, 4) or (n, 4, 4);
    `cov_rays` (n, 2, 2) or (2, 2) of the rays now.
    """
    far = directions(now_from_anchor, rays_anchor)
    t = now_from_anchor[..., :3, 3]
    along = t[..., :2] - rays_now * t[..., 2:]
    offset = rays_now * far[:, 2:] - far[:, :2]
    weighted = np.linalg.solve(cov_rays, along[..., None])[..., 0]
    information = np.maximum((weighted * along).sum(1), 1e-12)  # finite variance without parallax
    return (weighted * offset).sum(1) / information, far[:, 2] ** 2 / information


def directions(now_from_anchor: Array, rays_anchor: Array) -> Array:
    """R a (n, 3): where rays (n, 2) point in today's camera, at unit depth in their own."""
    a = np.concatenate([rays_anchor, np.ones((len(rays_anchor), 1))], axis=1)
    return np.asarray((now_from_anchor[..., :3, :3] @ a[..., None])[..., 0])
