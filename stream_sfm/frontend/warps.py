"""How a patch looks now: the projective map between its pixels now and in its template's frame.

What the affine part of the map leaves moves every patch of a turning camera the same way, by hundredths of a pixel that
an estimator takes for motion: docs/mathematics.md, section 3.
"""

import numpy as np

from ..geometry import se3
from ..geometry.se3 import Array
from ..geometry.stereo import MIN_DEPTH, StereoProjection
from .tracks import Tracks

_MIN_DETERMINANT = 1e-3  # a surface seen edge-on gets a finite warp that no template fits (`TemplateAtlas.fits`)


def anchor_from_now(tracks: Tracks, cam_from_start: Array, projection: StereoProjection) -> tuple[Array, Array]:
    """Warps (n, 3, 2) of pixel offsets, now to anchor, for the left and for the right image.

    `tracks` in the camera `cam_from_start` (4, 4) of the front-end's chain of motions. Around the anchor the surface
    is P(δ) = (x + δ₁, y + δ₂, 1, ρ + slopes·δ), and its image now is u = A δ / (1 + n·δ) with n the relative change of
    depth: exact for a plane. Inverted, δ = W u / (1 + h·u) with W = A⁻¹ and h = −Wᵀn; a warp is W above h.
    """
    now_from_anchor = cam_from_start @ se3.inverse(tracks.anchor_from_start)
    there = (se3.inverse(now_from_anchor) @ tracks.points[..., None])[..., 0]
    there = there / np.maximum(there[:, 2:3], MIN_DEPTH)
    here = (now_from_anchor @ there[..., None])[..., 0]
    depth = np.maximum(here[:, 2], MIN_DEPTH)[:, None, None]
    moved = now_from_anchor[:, :3, :2] + now_from_anchor[:, :3, 3:] * tracks.slopes[:, None, :]
    left = (moved[:, :2] - here[:, :2, None] / depth * moved[:, 2:]) / depth
    right = left.copy()
    shift = tracks.slopes - here[:, 3:] / depth[:, 0] * moved[:, 2]
    right[:, 0] -= projection.baseline_m * shift / depth[:, 0]
    by_depth = moved[:, 2:] / depth / projection.f_px
    return _warps(left, by_depth), _warps(right, by_depth)


def facing(n: int) -> Array:
    """Warps (n, 3, 2) that change nothing."""
    return np.broadcast_to(np.eye(3, 2), (n, 3, 2))


def sheared(slopes: Array) -> Array:
    """Warps (n, 3, 2), right image to left template, of surfaces whose disparity has `slopes` (n, 2): affine."""
    warps = facing(len(slopes)).copy()
    warps[:, 0] -= slopes
    warps[:, :2] = _inverse(warps[:, :2])
    return warps


def _warps(a: Array, by_depth: Array) -> Array:
    """Warps (n, 3, 2) of the maps A (n, 2, 2) and n (n, 1, 2)."""
    w = _inverse(a)
    return np.concatenate([w, -by_depth @ w], axis=1)


def _inverse(m: Array) -> Array:
    """Inverses of (n, 2, 2), finite also of singular ones."""
    det = np.linalg.det(m)
    safe = np.where(np.abs(det) < _MIN_DETERMINANT, _MIN_DETERMINANT, det)
    adjugate = np.stack([m[:, 1, 1], -m[:, 0, 1], -m[:, 1, 0], m[:, 0, 0]], axis=1).reshape(-1, 2, 2)
    return adjugate / safe[:, None, None]
