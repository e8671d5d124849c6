"""Consistency of the pose covariances: the normalised estimation error squared (NEES)."""

import numpy as np

from ..geometry import se3
from ..geometry.linear import scaled_cholesky
from ..geometry.se3 import Array
from .alignment import from_first_camera


def nees_pose(estimate: Array, cov_pose: Array, truth: Array) -> Array:
    """Return the NEES (n,) of poses (n, 4, 4): ξᵀ Σ⁻¹ ξ with truth = estimate·Exp(ξ), eq. (59); 6 is expected.

    Both trajectories are expressed in the axes of their first camera. `cov_pose` (n, 6, 6) belongs to the right
    perturbation relative to the first camera, translation first. NaN where the covariance is zero (the first frame,
    exact by definition) or not finite; infinite where it is not positive definite.
    """
    xi = se3.log(se3.inverse(from_first_camera(estimate)) @ from_first_camera(truth))
    result = np.full(len(xi), np.nan)
    for i in np.flatnonzero(np.isfinite(cov_pose).all(axis=(1, 2)) & cov_pose.any(axis=(1, 2))):
        result[i] = _mahalanobis2(xi[i], cov_pose[i])
    return result


def nees_pose_mean(estimate: Array, cov_pose: Array, truth: Array) -> float:
    """Return the mean of `nees_pose` over the frames where it is defined; NaN if there are none."""
    values = nees_pose(estimate, cov_pose, truth)
    values = values[~np.isnan(values)]
    return float(values.mean()) if len(values) else float("nan")


def _mahalanobis2(x: Array, cov: Array) -> float:
    """Return xᵀ Σ⁻¹ x; infinite where Σ is not positive definite."""
    if (np.diag(cov) <= 0).any():
        return float("inf")
    try:
        half = scaled_cholesky(cov)
    except np.linalg.LinAlgError:
        return float("inf")
    whitened = np.linalg.solve(half, x)
    return float(whitened @ whitened)
