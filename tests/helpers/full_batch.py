"""All frames and all points at once: the maximum-likelihood adjustment, which windows are compared with."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stream_sfm.estimators.baselines.bundle_adjustment import Adjustment, Reduced, adjust
from stream_sfm.estimators.baselines.full_batch import gather_views
from stream_sfm.geometry.se3 import Array
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.types import Observations

# Relative decrease of the sum of squares. Trades a few iterations for figures that agree with other solvers to 1e-7.
_TOLERANCE = 1e-14
_MAX_ITERATIONS = 50


@dataclass(frozen=True, slots=True)
class BatchResult:
    """The full adjustment: `world_from_cam` (n, 4, 4), `points_in_world` (p, 3) m of `track_ids` (p,), covariances."""

    world_from_cam: Array
    track_ids: NDArray[np.int64]
    points_in_world: Array
    cov_poses: Array
    cov_points_in_world: Array
    chi2: float
    iterations: int
    converged: bool


def batch_adjust(
    projection: StereoProjection,
    observations: Sequence[Observations],
    world_from_cam_start: Array,
    points_start: Array,
) -> BatchResult:
    """Minimise least squares over all views, with the first camera held and no outlier test.

    `world_from_cam_start` (n, 4, 4); `points_start` (p, 3) in the world, by ascending track id.
    """
    ids, views = gather_views(observations)
    free = np.arange(len(observations)) > 0
    result: Adjustment = adjust(
        projection, world_from_cam_start, points_start, views, free, None, _MAX_ITERATIONS, tolerance=_TOLERANCE
    )
    covariances = Reduced.build(projection, result.ref_from_cam, result.points, views, free).covariances()
    return BatchResult(
        world_from_cam=result.ref_from_cam,
        track_ids=ids,
        points_in_world=result.points,
        cov_poses=np.stack([covariances.cov_pose(k) for k in range(len(free))]),
        cov_points_in_world=covariances.cov_points,
        chi2=result.cost,
        iterations=result.iterations,
        converged=result.converged,
    )
