"""Does the covariance tell the truth? Normalised estimation error squared of poses (NEES)."""

import numpy as np

from ..geometry import se3
from ..geometry.se3 import Array
from .alignment import from_first_camera


def nees_pose(estimate: Array, cov_pose: Array, truth: Array) -> Array:
    """ξᵀ Σ⁻¹ ξ (n,) with truth = estimate·Exp(ξ), both in axes of their first camera; 6 is expected, eq. (59).

    Poses (n, 4, 4), `cov_pose` (n, 6, 6) of the right perturbation relative to the first camera, translation
    first. NaN where the covariance is zero (the first frame, exact by definition) or not finite; infinite where
    it is not positive definite.
    """
    xi = se3.log(se3.inverse(from_first_camera(estimate)) @ from_first_camera(truth))
    result = np.full(len(xi), np.nan)
    for i in np.flatnonzero(np.isfinite(cov_pose).all(axis=(1, 2)) & cov_pose.any(axis=(1, 2))):
        result[i] = _mahalanobis2(xi[i], cov_pose[i])
    return result


def nees_pose_mean(estimate: Array, cov_pose: Array, truth: Array) -> float:
    """Mean of `nees_pose` over the frames where it is defined; NaN where there is none."""
    values = nees_pose(estimate, cov_pose, truth)
    values = values[~np.isnan(values)]
    return float(values.mean()) if len(values) else float("nan")


def _mahalanobis2(x: Array, cov: Array) -> float:
    """xᵀ Σ⁻¹ x by Cholesky, scaled by the diagonal first (metres against radians)."""
    d = np.diag(cov)
    if (d <= 0).any():
        return float("inf")
    scale = 1 / np.sqrt(d)
    try:
        half = np.linalg.cholesky(cov * np.outer(scale, scale))
    except np.linalg.LinAlgError:
        return float("inf")
    whitened = np.linalg.solve(half, x * scale)
    return float(whitened @ whitened)
