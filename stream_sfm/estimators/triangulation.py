"""New points from one stereo view, and points and poses carried between frames with their covariances."""

import numpy as np
from numpy.typing import NDArray

from ..geometry import Array, se3
from ..geometry.linear import matvec, symmetric
from ..geometry.stereo import KNOWN_DEPTH_SIGMAS, StereoProjection, clamp_depth, information_of_views
from ..types import Observations


def usable_births(projection: StereoProjection, z_px: Array, cov_px: Array) -> NDArray[np.bool_]:
    """Return which views (n, 4) can start a metric point: both sides seen and a disparity well above its σ."""
    disparity = (z_px[:, 0] - projection.cx_left_px) - (z_px[:, 2] - projection.cx_right_px)
    variance = cov_px[:, 0, 0] + cov_px[:, 2, 2] - 2 * cov_px[:, 0, 2]
    with np.errstate(invalid="ignore"):
        return np.isfinite(z_px).all(axis=1) & (disparity > KNOWN_DEPTH_SIGMAS * np.sqrt(np.abs(variance)))


def triangulate(projection: StereoProjection, z_px: Array, cov_px: Array) -> tuple[Array, Array]:
    """Return the most likely points (n, 3) m of complete views (n, 4), and covariances (n, 3, 3) m², eq. (12)."""
    points = projection.triangulate(z_px)
    info = information_of_views(z_px, cov_px)
    cov: Array = np.zeros((len(points), 3, 3))
    for _ in range(3):  # Gauss-Newton; the start is wrong only by the difference of the two rows
        a = projection.jacobian(points)
        at = np.swapaxes(a, 1, 2) @ info
        cov = np.asarray(np.linalg.inv(at @ a))
        points = clamp_depth(points + matvec(cov @ at, z_px - projection.project(points)))
    return points, symmetric(cov)


def compose_cov(cov_first: Array, second_from_first_pose: Array, cov_second: Array) -> Array:
    """Return the covariance of A·B (right perturbations, independent), eq. (5): Ad(B⁻¹) Σ_A Ad(B⁻¹)ᵀ + Σ_B."""
    ad = se3.adjoint(se3.inverse(second_from_first_pose))
    return symmetric(ad @ cov_first @ ad.T + cov_second)


def points_to_world(
    world_from_ref: Array, cov_ref: Array, points_in_ref: Array, cov_points: Array
) -> tuple[Array, Array]:
    """Transform points (n, 3) from an uncertain frame, eq. (6): Σ' = R (Σ + J Γ Jᵀ) Rᵀ, J = [I,
    −[X]×]."""
    r = world_from_ref[:3, :3]
    j = -se3.point_in_source_jacobian(points_in_ref)
    cov = r @ (cov_points + j @ cov_ref @ np.swapaxes(j, 1, 2)) @ r.T
    return se3.transform(world_from_ref, points_in_ref), symmetric(cov)


def counted_cov(observations: Observations, rows: NDArray[np.intp]) -> Array:
    """Return the covariances (k, 4, 4) of views `rows` for a filter that sums up the views of a track, eq. (69)."""
    cov = observations.cov_px[rows]
    if observations.lasting.inflation is None:
        return cov
    root = np.repeat(np.sqrt(observations.lasting.inflation[rows]), 2, axis=1)
    return np.asarray(cov * root[:, :, None] * root[:, None, :])
