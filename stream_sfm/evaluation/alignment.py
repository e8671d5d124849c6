"""Alignment of an estimated trajectory with its ground truth."""

import numpy as np

from ..geometry import se3
from ..geometry.se3 import Array


def from_first_camera(world_from_cam: Array) -> Array:
    """Express poses (n, 4, 4) in the axes of their first camera; two such trajectories have aligned first poses."""
    return se3.inverse(world_from_cam[0]) @ world_from_cam


def umeyama(target: Array, source: Array, with_scale: bool = False) -> tuple[float, Array]:
    """Find the scale s and rigid motion (4, 4) that minimise Σ‖target − (s·R·source + t)‖² over points (n, 3), n ≥ 1.

    S. Umeyama, PAMI 1991, eqs. 40–42; s = 1 without `with_scale`. Where the points do not determine the rotation
    (on a line, or all in one place), one of the minimisers is returned; the residual is the same. The scale of a
    source without extent is NaN.
    """
    mean_t, mean_s = target.mean(axis=0), source.mean(axis=0)
    t0, s0 = target - mean_t, source - mean_s
    u, d, vt = np.linalg.svd(t0.T @ s0 / len(target))
    sign = np.ones(3)
    sign[2] = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    rotation = u @ np.diag(sign) @ vt
    scale = 1.0
    if with_scale:
        variance = float((s0**2).sum() / len(source))
        scale = float((d * sign).sum() / variance) if variance > 0 else float("nan")
    return scale, se3.from_rotation_translation(rotation, mean_t - scale * rotation @ mean_s)
