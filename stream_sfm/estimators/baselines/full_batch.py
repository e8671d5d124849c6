"""The bound on every estimator, from all frames and all points at once.

The Cramér–Rao bound, eq. (46), is the inverse Fisher information at the truth with the first camera fixed; for
Gaussian noise it is the adjustment's own covariance evaluated at the truth.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...geometry import se3
from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection
from ...types import Observations
from .bundle_adjustment import Covariances, NormalEquations, WeightedViews


@dataclass(frozen=True, slots=True)
class Bound:
    """The covariances of the best unbiased estimate from frames 0 … n.

    `cov_poses` (n+1, 6, 6) m², rad², right perturbation of world_from_cam, zero for the first; of the points in
    view of frame n, `track_ids` (m,): `cov_points_in_world`, `cov_points_in_cam` (m, 3, 3) m².
    """

    cov_poses: Array
    track_ids: NDArray[np.int64]
    cov_points_in_world: Array
    cov_points_in_cam: Array


def gather_views(observations: Sequence[Observations]) -> tuple[NDArray[np.int64], WeightedViews]:
    """Return the ascending track ids of a sequence and its views as rows, whose point index is the row of the id."""
    ids = np.concatenate([o.track_ids for o in observations])
    frame = np.repeat(np.arange(len(observations)), [len(o.track_ids) for o in observations])
    z = np.concatenate([o.z_px for o in observations])
    cov = np.concatenate([o.cov_px for o in observations])
    unique, point = np.unique(ids, return_inverse=True)
    return unique, WeightedViews.sorted_by_point(frame, point, z, cov)


def cramer_rao_bound(
    projection: StereoProjection,
    observations: Sequence[Observations],
    world_from_cam: Array,
    points_in_world: Array,
    frame: int | None = None,
) -> Bound:
    """Return the bound at `frame` (default the last) from all views up to it, at the true poses (n, 4, 4) and points.

    `points_in_world` (p, 3) is indexed by track id. Of the observations only ids and covariances matter.
    """
    last = len(observations) - 1 if frame is None else frame
    ids, views = gather_views(observations[: last + 1])
    free = np.arange(last + 1) > 0
    points = points_in_world[ids]
    normal = NormalEquations.build(projection, world_from_cam[: last + 1], points, views)
    now = np.flatnonzero(np.isin(ids, observations[last].track_ids))
    covariances = Covariances.of(normal.eliminate_points(free), free, now)
    in_cam = se3.transform(se3.inverse(world_from_cam[last]), points[now])
    return Bound(
        cov_poses=np.stack([covariances.cov_pose(k) for k in range(last + 1)]),
        track_ids=ids[now],
        cov_points_in_world=covariances.cov_points,
        cov_points_in_cam=covariances.cov_points_in_cam(last, world_from_cam[last], in_cam),
    )
