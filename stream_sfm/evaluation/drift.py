"""Drift at the end of the path, and scale error. Arguments are poses world_from_cam (n, 4, 4), row by row."""

import numpy as np

from ..geometry.se3 import Array
from .alignment import from_first_camera, umeyama

_STANDING_M = 1e-3  # a shorter path or extent counts as standing still: a percentage of it would be noise


def distances_m(world_from_cam: Array) -> Array:
    """Return the distance travelled (n,) up to each pose, in metres."""
    steps = np.linalg.norm(np.diff(world_from_cam[:, :3, 3], axis=0), axis=1)
    return np.concatenate([np.zeros(min(1, len(world_from_cam))), np.cumsum(steps)])


def path_length_m(world_from_cam: Array) -> float:
    """Return the length of the path through all positions, in metres; shaking and noise add to it."""
    return float(distances_m(world_from_cam)[-1]) if len(world_from_cam) else 0.0


def final_drift_percent(estimate: Array, truth: Array) -> float:
    """Return the end-point error in per cent of the true path, first poses aligned, eq. (54); NaN without motion."""
    length = path_length_m(truth)
    if length < _STANDING_M:
        return float("nan")
    end_error = from_first_camera(estimate)[-1, :3, 3] - from_first_camera(truth)[-1, :3, 3]
    return 100 * float(np.linalg.norm(end_error)) / length


def scale_error_percent(estimate: Array, truth: Array) -> float:
    """Return by how many per cent the estimate is too large, eq. (58), negative: too small; NaN when standing still.

    1/s − 1 for the similarity scale s that aligns the estimated positions with the true ones (Umeyama 1991, eq. 42).
    The ratio of path lengths would be biased by the noise of each pose.
    """
    e, t = estimate[:, :3, 3], truth[:, :3, 3]
    if len(t) < 2 or np.ptp(t, axis=0).max() < _STANDING_M or np.ptp(e, axis=0).max() == 0:
        return float("nan")
    scale, _ = umeyama(t, e, with_scale=True)
    return 100 * (1 / scale - 1)
