"""Absolute trajectory error (ATE), eq. (53): distances between estimated and true positions, in metres.

Arguments are poses world_from_cam (n, 4, 4) with equal stamps row by row.
"""

import numpy as np

from ..geometry import se3
from ..geometry.se3 import Array
from .alignment import from_first_camera, umeyama


def ate_rmse_m(estimate: Array, truth: Array) -> float:
    """Return the RMS position error with only the first poses aligned."""
    e, t = from_first_camera(estimate), from_first_camera(truth)
    return _rms(e[:, :3, 3] - t[:, :3, 3])


def ate_rmse_aligned_m(estimate: Array, truth: Array) -> float:
    """Return the RMS position error after the best rigid alignment: SE(3), without scale (Umeyama 1991)."""
    _, truth_from_estimate = umeyama(truth[:, :3, 3], estimate[:, :3, 3])
    return _rms(se3.transform(truth_from_estimate, estimate[:, :3, 3]) - truth[:, :3, 3])


def ate_rmse_sim3_m(estimate: Array, truth: Array) -> tuple[float, float]:
    """Return the RMS position error after the best similarity, eq. (67), and metres per unit of the estimate.

    Only for one camera, which does not determine its scale.
    """
    scale, truth_from_estimate = umeyama(truth[:, :3, 3], estimate[:, :3, 3], with_scale=True)
    placed = se3.transform(truth_from_estimate, scale * estimate[:, :3, 3])
    return _rms(placed - truth[:, :3, 3]), scale


def _rms(differences: Array) -> float:
    return float(np.sqrt((differences**2).sum(axis=-1).mean()))
