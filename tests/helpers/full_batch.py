"""The maximum-likelihood adjustment of all frames and points at once, as a reference for windows."""

from collections.abc import Sequence

import numpy as np

from stream_sfm.estimators.baselines.bundle_adjustment import Adjustment, Covariances, Problem
from stream_sfm.estimators.baselines.full_batch import gather_views
from stream_sfm.geometry.se3 import Array
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.types import Observations


def batch_adjust(
    projection: StereoProjection,
    observations: Sequence[Observations],
    world_from_cam_start: Array,
    points_start: Array,
) -> tuple[Adjustment, Covariances]:
    """The least squares solution over all views, with the first camera held and no outlier test.

    `world_from_cam_start` (n, 4, 4); `points_start` (p, 3) in the world, by ascending track id.
    """
    _, views = gather_views(observations)
    problem = Problem(projection, views, np.arange(len(observations)) > 0)
    # to a relative decrease of the squares for which figures agree with those of other solvers to 1e-7
    found = problem.minimum(world_from_cam_start, points_start, 50, tolerance=1e-14)
    return found, problem.linearised(found.ref_from_cam, found.points).covariances()
