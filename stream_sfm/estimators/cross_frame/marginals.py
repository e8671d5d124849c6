"""Reads the one solution twice: CC (structure in the newest camera) and WC (pose and structure in the world).

Both come from the same joint covariance of poses, points and world, so they are consistent with each other: eqs. (37)
and (38), and eqs. (39)–(41).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...geometry import se3
from ...geometry.linear import symmetric
from ...geometry.se3 import Array
from ...geometry.stereo import KNOWN_DEPTH_SIGMAS, clamp_depth
from ..lifecycle import WorldPoints
from .inverse_depth import (
    Q_COLUMNS,
    homogeneous_from_q,
    in_reference,
    metric_jacobian,
    pose_jacobian,
    q_from_homogeneous,
    q_jacobian,
)
from .normal_equations import System


@dataclass(frozen=True, slots=True)
class Marginals:
    """Marginal estimates of the newest pose and of all points of the map (n).

    `q_in_cam`: q in the newest camera; metric points in that camera and in the world; each with its covariance, that of
    q given the rig's errors: they do the same to the next views of the points, and cancel between two frames.
    `finite` (n,) bool: the depth is known well enough for metres; the metric rows of the others have no meaning.
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

    @classmethod
    def compute(
        cls,
        system: System,
        ids: NDArray[np.int64],
        ref_from_anchor: Array,
        q: Array,
        world_from_ref: Array,
        cam_from_ref: Array,
        newest: int,
    ) -> "Marginals":
        """Marginalise the factored system; `newest` is the row of the newest frame, −1 where that is the reference."""
        cov = system.covariances(newest)
        in_ref = in_reference(ref_from_anchor, q)
        in_cam = clamp_depth(in_ref @ cam_from_ref.T)  # points behind this camera are not shown in it
        finite = q[:, 2] > KNOWN_DEPTH_SIGMAS * np.sqrt(cov.qq[:, 2, 2])

        k = q_jacobian(in_cam)
        by_q = k @ cam_from_ref @ ref_from_anchor[:, :, Q_COLUMNS]
        cov_q = _propagate(by_q, cov.qq, k @ pose_jacobian(in_cam), cov.xx, cov.qx)
        by_rig = by_q @ cov.q_by_rig + k @ pose_jacobian(in_cam) @ cov.x_by_rig
        q_in_cam = q_from_homogeneous(in_cam)
        here = _with_unit_scale(homogeneous_from_q(q_in_cam), ~finite)
        d = metric_jacobian(here)[..., Q_COLUMNS]

        there = _with_unit_scale(in_ref, ~finite)
        points_in_ref = there[:, :3] / there[:, 3:]
        r_w = world_from_ref[:3, :3]
        world_by_q = r_w @ metric_jacobian(there) @ ref_from_anchor[:, :, Q_COLUMNS]
        world_by_w = r_w @ -se3.point_in_source_jacobian(points_in_ref)

        ad = se3.adjoint(cam_from_ref)
        cov_pose = ad @ cov.ww @ ad.T + cov.xx - ad @ cov.xw.T - cov.xw @ ad.T
        return cls(
            ids=ids,
            world_from_cam=se3.orthonormalise(world_from_ref @ se3.inverse(cam_from_ref)),
            cov_pose=symmetric(cov_pose),
            q_in_cam=q_in_cam,
            cov_q_in_cam=symmetric(cov_q - by_rig @ np.swapaxes(by_rig, 1, 2)),
            points_in_cam=here[:, :3] / here[:, 3:],
            cov_points=symmetric(d @ cov_q @ np.swapaxes(d, 1, 2)),
            points_in_world=se3.transform(world_from_ref, points_in_ref),
            cov_points_in_world=_propagate(world_by_q, cov.qq, world_by_w, cov.ww, cov.qw),
            finite=finite,
        )

    def doubted(self, cov: Array) -> "Marginals":
        """Return the same where the newest pose may be wrong by `cov` (6, 6) more, with all that is seen from it."""
        j, r = se3.point_in_source_jacobian(self.points_in_cam), self.world_from_cam[:3, :3]
        of_points = r @ (j @ cov @ np.swapaxes(j, 1, 2)) @ r.T
        return replace(
            self,
            cov_pose=self.cov_pose + cov,
            cov_points_in_world=symmetric(self.cov_points_in_world + of_points),
        )

    def ended(self, rows: NDArray[np.bool_]) -> WorldPoints:
        """Return those of the points (n,) bool that leave the map and have a position in metres."""
        rows = rows & self.finite
        return WorldPoints(self.ids[rows], self.points_in_world[rows], self.cov_points_in_world[rows])


def _with_unit_scale(points: Array, rows: NDArray[np.bool_]) -> Array:
    """Return homogeneous points (n, 4) with a last coordinate of 1 in `rows`, whose numbers then have no meaning."""
    points = points.copy()
    points[rows, 3] = 1.0
    return points


def _propagate(jq: Array, cov_qq: Array, jy: Array, cov_y: Array, cov_qy: Array) -> Array:
    """Return the covariance of Jq δq + Jy δy for each point."""
    half = jq @ cov_qy @ np.swapaxes(jy, 1, 2)
    cov = jq @ cov_qq @ np.swapaxes(jq, 1, 2) + jy @ cov_y @ np.swapaxes(jy, 1, 2) + half + np.swapaxes(half, 1, 2)
    return symmetric(cov)
