"""Reads the one solution twice: CC (structure in the newest camera) and WC (pose and structure in the world).

Both come from the same joint covariance of poses, points and world, so they are consistent with each other: eqs. (37)
and (38), and eqs. (39)–(41).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...geometry import se3
from ...geometry.linear import symmetric
from ...geometry.se3 import Array
from .inverse_depth import (
    CHART,
    homogeneous_from_q,
    in_reference,
    metric_jacobian,
    pose_jacobian,
    q_from_homogeneous,
    q_jacobian,
)
from .normal_equations import System

# A point whose inverse depth is not known to a third has no Gaussian in metres; it is used but not reported.
_MIN_DEPTH_SIGMAS = 3.0


@dataclass(frozen=True, slots=True)
class Reading:
    """All points of the state (n): ids, `q_in_cam` with covariance, metric points in camera and world with theirs.

    `finite` (n,) bool: the depth is known well enough for metres; the metric rows of the others mean nothing.
    """

    ids: NDArray[np.int64]
    world_from_cam: Array
    cov_pose: Array
    q_in_cam: Array
    cov_q_in_cam: Array
    points_in_cam: Array
    cov_points: Array
    points_in_world: Array
    cov_points_in_world: Array
    finite: NDArray[np.bool_]

    def ended(self, which: NDArray[np.bool_]) -> tuple[NDArray[np.int64], Array, Array]:
        """Ids, world points and covariances of the points (n,) bool that leave the state, as a Solution has them."""
        which = which & self.finite
        return self.ids[which], self.points_in_world[which], self.cov_points_in_world[which]


def read_structure(
    system: System,
    ids: NDArray[np.int64],
    charts: Array,
    q: Array,
    world_from_ref: Array,
    cam_from_ref: Array,
    newest: int,
) -> Reading:
    """The reading from the window's factored system; `newest` is the row of the newest frame, −1 for the reference."""
    cov_qq, cov_qx, cov_qw, cov_x, cov_w, cov_xw = system.covariances(newest)
    in_ref = in_reference(charts, q)
    in_cam = in_ref @ cam_from_ref.T
    in_cam[:, 2] = np.maximum(in_cam[:, 2], 1e-3)  # of points behind this camera, which are not shown in it
    finite = q[:, 2] > _MIN_DEPTH_SIGMAS * np.sqrt(cov_qq[:, 2, 2])

    k = q_jacobian(in_cam)
    m = k @ cam_from_ref @ charts[:, :, CHART]
    kg = k @ pose_jacobian(in_cam)
    cov_q = _propagated(m, cov_qq, kg, cov_x, cov_qx)
    q_in_cam = q_from_homogeneous(in_cam)
    here = _with_rho(homogeneous_from_q(q_in_cam), finite)
    d = metric_jacobian(here)[..., CHART]

    there = _with_rho(in_ref, finite)
    points_in_ref = there[:, :3] / there[:, 3:]
    r_w = world_from_ref[:3, :3]
    jq = r_w @ metric_jacobian(there) @ charts[:, :, CHART]
    jw = r_w @ np.concatenate([np.broadcast_to(np.eye(3), (len(q), 3, 3)), -se3.skew(points_in_ref)], axis=2)

    ad = se3.adjoint(cam_from_ref)
    cov_pose = ad @ cov_w @ ad.T + cov_x - ad @ cov_xw.T - cov_xw @ ad.T
    return Reading(
        ids=ids,
        world_from_cam=se3.orthonormalise(world_from_ref @ se3.inverse(cam_from_ref)),
        cov_pose=symmetric(cov_pose),
        q_in_cam=q_in_cam,
        cov_q_in_cam=cov_q,
        points_in_cam=here[:, :3] / here[:, 3:],
        cov_points=symmetric(d @ cov_q @ np.swapaxes(d, 1, 2)),
        points_in_world=se3.transform(world_from_ref, points_in_ref),
        cov_points_in_world=_propagated(jq, cov_qq, jw, cov_w, cov_qw),
        finite=finite,
    )


def _with_rho(points: Array, finite: NDArray[np.bool_]) -> Array:
    """Homogeneous points (n, 4) whose last coordinate is 1 where the depth is not known: numbers without meaning."""
    points = points.copy()
    points[~finite, 3] = 1.0
    return points


def _propagated(jq: Array, cov_qq: Array, jy: Array, cov_y: Array, cov_qy: Array) -> Array:
    """Covariance of Jq δq + Jy δy for each point."""
    half = jq @ cov_qy @ np.swapaxes(jy, 1, 2)
    cov = jq @ cov_qq @ np.swapaxes(jq, 1, 2) + jy @ cov_y @ np.swapaxes(jy, 1, 2) + half + np.swapaxes(half, 1, 2)
    return symmetric(cov)
