"""Brings surveyed coordinates into the world of a run, with the uncertainty of that."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import ConfigError
from ..geometry import se3
from ..geometry.linear import scaled_inverse
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection, clamp_depth
from .alignment import umeyama

_MIN_POINTS = 3
# Of the extent of those points: the least they spread sideways, so that no turn about a line is left open.
_LINE = 0.02
_STEPS = 20  # Gauss-Newton; from the triangulated points it takes three or four
_CONVERGED = 1e-12  # metres and radians, squared


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Tie:
    """`world_from_survey` (4, 4), in axes of the rectified camera; `frame`: the one whose sightings it is made from.

    `cov` (6, 6) of ξ in Exp(ξ)·world_from_survey; NaN where the world of the run is itself uncertain there.
    """

    world_from_survey: Array
    cov: Array
    frame: int | None = None

    def cov_of_points(self, points_in_world: Array, std_m: float) -> Array:
        """Covariances (n, 3, 3) of surveyed points in the world, with σ `std_m` of their coordinates."""
        j = se3.point_in_source_jacobian(points_in_world)
        return np.asarray(std_m**2 * np.eye(3) + j @ self.cov @ np.swapaxes(j, 1, 2))


def tie_frame(frames: NDArray[np.int64], point_rows: NDArray[np.int64], z_px: Array, positions_m: Array) -> int:
    """The first frame that sees enough points with both cameras. Raises ConfigError where none does."""
    both = np.isfinite(z_px).all(axis=1)
    for frame in np.unique(frames[both]).tolist():
        seen = positions_m[np.unique(point_rows[both & (frames == frame)])]
        spread = np.linalg.svd(seen - seen.mean(axis=0), compute_uv=False)
        if len(seen) >= _MIN_POINTS and spread[1] > _LINE * spread[0]:
            return int(frame)
    raise ConfigError(
        f"test points: no frame of the run shows {_MIN_POINTS} points, not on a line, in both images, so the survey's "
        'axes cannot be tied to the run: mark more of them in one frame, or say whose axes they are: world = "first '
        'camera" or "ground truth"'
    )


def tie_by_points(
    projection: StereoProjection, z_px: Array, positions_m: Array, std_px: float, std_m: float
) -> tuple[Array, Array]:
    """The pose cam_from_survey (4, 4) that brings points (n, 3) onto their views (n, 4), and its covariance (6, 6).

    A side of a view that is NaN does not count. The pose moves as Exp(ξ)·cam_from_survey.
    """
    seen = np.isfinite(z_px)
    both = seen.all(axis=1)
    _, pose = umeyama(projection.triangulate(z_px[both]), positions_m[both])
    known: Array = np.zeros((6, 6))
    for _ in range(_STEPS):
        points = clamp_depth(se3.transform(pose, positions_m))
        a = projection.jacobian(points)
        cov_px = std_px**2 * np.eye(4) + std_m**2 * a @ np.swapaxes(a, 1, 2)
        information = np.where(seen[:, :, None] & seen[:, None, :], np.linalg.inv(_only(cov_px, seen)), 0.0)
        j = -a @ se3.point_in_source_jacobian(points)
        residual = np.where(seen, z_px - projection.project(points), 0.0)
        jt = np.swapaxes(j, 1, 2) @ information
        cov = scaled_inverse((jt @ j).sum(axis=0))
        if cov is None:
            raise ConfigError("test points: those of the first frame that shows enough of them do not fix its pose")
        known = cov
        step = cov @ (jt @ residual[:, :, None]).sum(axis=0)[:, 0]
        pose = se3.orthonormalise(se3.exp(step) @ pose)
        if step @ step < _CONVERGED:
            break
    return pose, known


def _only(cov_px: Array, seen: NDArray[np.bool_]) -> Array:
    """Covariances (n, 4, 4) of what was seen, beside 1 for what was not."""
    return np.where(seen[:, :, None] & seen[:, None, :], cov_px, np.eye(4))
