"""Depths from the motion of one camera: each point on the ray of the frame where its template was cut."""

from dataclasses import dataclass, fields, replace

import numpy as np

from ...geometry import se3
from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection
from ..tracks import Tracks

_MIN_DEPTH = 1e-3  # here, of a point at depth 1 in its anchor camera
_FORGET = 1.1  # of the variance each frame, as in `Tracks.measured`
_NO_PARALLAX = 1e-12  # information of a view that shows none


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
    information = np.maximum((weighted * along).sum(1), _NO_PARALLAX)
    return (weighted * offset).sum(1) / information, far[:, 2] ** 2 / information


def directions(now_from_anchor: Array, rays_anchor: Array) -> Array:
    """R a (n, 3): where rays (n, 2) point in today's camera, at unit depth in their own."""
    a = np.concatenate([rays_anchor, np.ones((len(rays_anchor), 1))], axis=1)
    return np.asarray((now_from_anchor[..., :3, :3] @ a[..., None])[..., 0])


@dataclass(frozen=True, slots=True)
class MonoTracks(Tracks):
    """`Tracks` with the ray (n, 2) of each in its anchor camera: the middle of its template, exact by definition."""

    anchor_rays: Array

    @classmethod
    def none(cls) -> "MonoTracks":
        """No rows."""
        nothing = Tracks.none()
        return cls(**{f.name: getattr(nothing, f.name) for f in fields(nothing)}, anchor_rays=np.empty((0, 2)))

    def placed(self, left_px: Array, p: StereoProjection) -> "MonoTracks":
        """Points put where they were seen (n, 2), inverse depths as they are."""
        points = np.concatenate([p.rays(left_px), self.points[:, 2:]], axis=1)
        return replace(self, left_px=left_px.copy(), points=points)

    def with_depths(self, z_px: Array, cov_px: Array, cam_from_start: Array, p: StereoProjection) -> "MonoTracks":
        """Points put where they were seen; the inverse depth by a scalar Kalman update in the anchor camera, where
        the parallax of all frames since adds up.

        With Z(ρ) = (R a)₃ + t₃ ρ, a point of inverse depth ρ there has ρ/Z here.
        """
        now_from_anchor = cam_from_start @ se3.inverse(self.anchor_from_start)
        rays = p.rays(z_px)
        seen, var_seen = depths_from_motion(now_from_anchor, self.anchor_rays, rays, cov_px[:, :2, :2] / p.f_px**2)
        far = np.maximum(directions(now_from_anchor, self.anchor_rays)[:, 2], _MIN_DEPTH)
        t = now_from_anchor[:, 2, 3]
        rho = self.points[:, 3] * far / np.maximum(1 - t * self.points[:, 3], _MIN_DEPTH)
        before = _FORGET * self.var_rho * (np.maximum(far + t * rho, _MIN_DEPTH) ** 2 / far) ** 2
        gain = before / (before + var_seen)
        rho = rho + gain * (seen - rho)
        depth = np.maximum(far + t * rho, _MIN_DEPTH)
        points = np.concatenate([rays, np.ones((len(rays), 1)), (rho / depth)[:, None]], axis=1)
        var_rho = (1 - gain) * before * (far / depth**2) ** 2
        return replace(self, left_px=z_px[:, :2].copy(), points=points, var_rho=var_rho)
