"""The table of live tracks: one row a point, ascending ids."""

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ..geometry import se3
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection


@dataclass(frozen=True, slots=True)
class Tracks:
    """Rows (n): `ids`, atlas `slots`, last left position `left_px` (n, 2); `points` (n, 4) homogeneous
    (X/Z, Y/Z, 1, 1/Z) in the current rectified camera and `var_rho` of the last; `anchor_from_start` (n, 4, 4): the
    pose of the frame where the template was cut, as the inverse of start_from_anchor in the front-end's own chain of
    motions; `slopes` (n, 2): ∂(1/Z)/∂(X/Z, Y/Z) of the surface in the anchor camera, 1/m.
    """

    ids: NDArray[np.int64]
    slots: NDArray[np.intp]
    left_px: Array
    points: Array
    var_rho: Array
    anchor_from_start: Array
    slopes: Array

    @classmethod
    def none(cls) -> "Tracks":
        """No rows."""
        return cls(
            np.empty(0, np.int64),
            np.empty(0, np.intp),
            np.empty((0, 2)),
            np.empty((0, 4)),
            np.empty(0),
            np.empty((0, 4, 4)),
            np.empty((0, 2)),
        )

    def __len__(self) -> int:
        return len(self.ids)

    def keep(self, rows: NDArray) -> Self:
        """The given rows (mask or indices)."""
        return type(self)(*(getattr(self, f.name)[rows] for f in fields(self)))

    def joined(self, other: Self) -> Self:
        """These rows, then the other's; the other's ids must be larger."""
        return type(self)(*(np.concatenate([getattr(self, f.name), getattr(other, f.name)]) for f in fields(self)))

    def moved(self, cam_from_previous: Array) -> Self:
        """Points carried into a new camera; `left_px` stays what was last measured."""
        points = self.points @ cam_from_previous.T
        depth = np.maximum(points[:, 2:3], 1e-3)
        return replace(self, points=points / depth, var_rho=self.var_rho / depth[:, 0] ** 2)

    def anchor_from_now(self, cam_from_start: Array, baseline_m: float) -> tuple[Array, Array]:
        """Warps (n, 2, 2) of pixel offsets, now to anchor, for the left and the right image.

        Around the anchor P(δ) = (x + δ₁, y + δ₂, 1, ρ + slopes·δ); its image now is linearised in δ and inverted.
        """
        now_from_anchor = cam_from_start @ se3.inverse(self.anchor_from_start)
        there = (se3.inverse(now_from_anchor) @ self.points[..., None])[..., 0]
        there = there / np.maximum(there[:, 2:3], 1e-3)
        here = (now_from_anchor @ there[..., None])[..., 0]
        depth = np.maximum(here[:, 2], 1e-3)[:, None, None]
        moved = now_from_anchor[:, :3, :2] + now_from_anchor[:, :3, 3:] * self.slopes[:, None, :]
        left = (moved[:, :2] - here[:, :2, None] / depth * moved[:, 2:]) / depth
        right = left.copy()
        shift = self.slopes - here[:, 3:] / depth[:, 0] * moved[:, 2]
        right[:, 0] -= baseline_m * shift / depth[:, 0]
        return _inverse(left), _inverse(right)

    def measured(self, z_px: Array, cov_px: Array, projection: StereoProjection) -> "Tracks":
        """Points put where they were seen; the inverse depth by a scalar Kalman update where the right side is seen."""
        p = projection
        scale = p.f_px * p.baseline_m
        rho = p.inverse_depth(z_px)
        var = (cov_px[:, 0, 0] + cov_px[:, 2, 2] - 2 * cov_px[:, 0, 2]) / scale**2
        seen = np.isfinite(rho)
        # a tenth of the variance more each frame forgets depths that were carried by a wrong motion
        before = 1.1 * self.var_rho
        gain = np.where(seen, before / (before + np.where(seen, var, 1.0)), 0.0)
        points = self.points.copy()
        points[:, 0] = (z_px[:, 0] - p.cx_left_px) / p.f_px
        points[:, 1] = (z_px[:, 1] - p.cy_px) / p.f_px
        points[:, 3] += gain * (np.where(seen, rho, 0.0) - points[:, 3])
        return replace(self, left_px=z_px[:, :2].copy(), points=points, var_rho=(1 - gain) * before)

    def cov_points(self, var_ray: float) -> Array:
        """Covariances (n, 4, 4) of `points`: the ray's variance, and that of the inverse depth."""
        cov = np.zeros((len(self), 4, 4))
        cov[:, 0, 0] = cov[:, 1, 1] = var_ray
        cov[:, 3, 3] = self.var_rho
        return cov


def _inverse(m: Array) -> Array:
    """Inverses of (n, 2, 2); a surface seen edge-on gets a warp that no template fits."""
    det = np.linalg.det(m)
    safe = np.where(np.abs(det) < 1e-3, 1e-3, det)
    adjugate = np.stack([m[:, 1, 1], -m[:, 0, 1], -m[:, 1, 0], m[:, 0, 0]], axis=1).reshape(-1, 2, 2)
    return adjugate / safe[:, None, None]
