"""How a frame that leaves a per-point window becomes priors of its points: the paper's choices of reference.

Each rule takes a `Leaving` frame; the priors are in the world (WC) or in the frame's own camera (CC).
"""

from collections.abc import Callable

import numpy as np

from ...geometry import Array, se3
from ...geometry.linear import symmetric
from ...geometry.stereo import StereoProjection
from ...record import record
from .bundle_adjustment import PointPriors, Problem, WeightedViews, residuals_and_jacobians


@record
class Leaving:
    """The oldest frame of a window, and the points (p) that it sees or that have a prior.

    `ref_from_cam` (4, 4) with `cov_pose` (6, 6) as estimated by the window, `held` if it is fixed; `points` (p, 3) in
    ref; `views`: those of the frame.
    """

    projection: StereoProjection
    ref_from_cam: Array
    cov_pose: Array
    held: bool
    points: Array
    priors: PointPriors
    views: WeightedViews


# Returns the priors of the same points in a new reference, and new_from_ref (4, 4); None where ref stays.
LeavingRule = Callable[[Leaving], tuple[PointPriors, Array | None]]


def world_centred(leaving: Leaving) -> tuple[PointPriors, Array | None]:
    """Fuse each view into its own point, with the noise of the pose as estimated by the window, eq. (47).

    Λ' = Λ + Bᵀ (Σ_z + J Γ Jᵀ)⁻¹ B, B = ∂h/∂X, J = ∂h/∂ξ.
    """
    priors, points, views = leaving.priors, leaving.points, leaving.views
    r, j_pose, j_point = residuals_and_jacobians(leaving.projection, leaving.ref_from_cam[None], points, views)
    # (Σ + J Γ Jᵀ)⁻¹ = Ω − Ω J (Γ⁻¹ + JᵀΩJ)⁻¹ JᵀΩ, written so that Γ = 0 and Ω singular are allowed.
    ji = np.swapaxes(j_pose, 1, 2) @ views.information
    gain = np.linalg.solve(np.eye(6) + leaving.cov_pose @ (ji @ j_pose), leaving.cov_pose @ ji)
    info = views.information - np.swapaxes(ji, 1, 2) @ gain
    jt = np.swapaxes(j_point, 1, 2) @ info
    information, right = priors.information.copy(), priors.information @ (priors.mean - points)[..., None]
    information[views.point] += jt @ j_point
    right[views.point] += jt @ r[..., None]
    delta = np.linalg.solve(information, right)[..., 0]
    return PointPriors(points + delta, symmetric(information)), None


def camera_centred(leaving: Leaving) -> tuple[PointPriors, Array | None]:
    """Transform points into the leaving camera with their joint covariance with its pose, eq. (49).

    That covariance is from priors and leaving views alone, linearised at the estimate of the window.
    """
    free = np.array([not leaving.held])
    problem = Problem(leaving.projection, leaving.views, free, leaving.priors)
    reduced = problem.linearised(leaving.ref_from_cam[None], leaving.points)
    xi, delta = reduced.solve()  # from the estimate of the window to their minimum
    cam_from_ref = se3.inverse(leaving.ref_from_cam)
    in_cam = se3.transform(cam_from_ref, leaving.points)
    j = se3.point_in_source_jacobian(in_cam)
    mean = in_cam + delta @ cam_from_ref[:3, :3].T + j @ xi.reshape(-1, 6).sum(axis=0)
    cov = reduced.covariances().cov_points_in_cam(0, leaving.ref_from_cam, in_cam)
    return PointPriors(mean, np.asarray(np.linalg.inv(cov))), cam_from_ref


def camera_centred_literal(leaving: Leaving) -> tuple[PointPriors, Array | None]:
    """Transform points as the paper does between two frames, then add the view from the leaving camera, eq. (48)."""
    priors = leaving.priors
    cam_from_ref = se3.inverse(leaving.ref_from_cam)
    r = cam_from_ref[:3, :3]
    mean = se3.transform(cam_from_ref, priors.mean)
    known = (priors.information != 0).any(axis=(1, 2), keepdims=True)
    cov = np.linalg.inv(np.where(known, priors.information, np.eye(3)))
    j = se3.point_in_source_jacobian(mean)
    cov = r @ cov @ r.T + j @ leaving.cov_pose @ np.swapaxes(j, 1, 2)
    carried = PointPriors(mean, np.where(known, np.linalg.inv(cov), 0.0))
    in_cam = se3.transform(cam_from_ref, leaving.points)  # where the view is linearised
    problem = Problem(leaving.projection, leaving.views, np.array([False]), carried)
    reduced = problem.linearised(np.eye(4)[None], in_cam)
    information = np.asarray(np.linalg.inv(reduced.covariances().cov_points))
    return PointPriors(in_cam + reduced.solve()[1], information), cam_from_ref
