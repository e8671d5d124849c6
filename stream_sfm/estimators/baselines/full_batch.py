"""The lower bound on the covariance of every estimator, from all frames and all points at once.

The Cramér–Rao bound, eq. (46), is the inverse Fisher information at the truth with the first camera fixed; for Gaussian
noise it is the adjustment's own covariance evaluated at the truth. An error that follows e_n = ρ e_n−1 + noise in units
of its σ, eq. (76), becomes white in the differences of successive views of a track, eq. (77); these couple the poses of
two neighbouring frames. The rig's errors c ~ N(0, I) shift all views according to `Observations.rig`.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...camera.refinement import LENS_TERMS
from ...geometry import Array, se3
from ...geometry.stereo import StereoProjection
from ...record import record
from ...types import Observations
from .bundle_adjustment import Reduced, WeightedViews, residuals_and_jacobians


@record
class Bound:
    """The covariances of the best unbiased estimate from frames 0 … n.

    `cov_poses` (n+1, 6, 6) m², rad², right perturbation of world_from_cam, zero for the first; `track_ids` (m,): the
    points visible in frame n, with `cov_points_in_world` and `cov_points_in_cam` (m, 3, 3) m².
    """

    cov_poses: Array
    track_ids: NDArray[np.int64]
    cov_points_in_world: Array
    cov_points_in_cam: Array


def gather_views(observations: Sequence[Observations]) -> tuple[NDArray[np.int64], WeightedViews]:
    """Return the ascending track ids of a sequence, and its views as rows; their point index is the row of the id."""
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
    autocorrelation: float = 0.0,
) -> Bound:
    """Return the bound at `frame` (default the last) from all views up to it, at the true poses (n, 4, 4) and points.

    `points_in_world` (p, 3) is indexed by track id; both sides must be seen, and tracks must have no gaps.
    `autocorrelation`: of the errors of successive views. Only ids, covariances and rig of the observations are used.
    """
    last = len(observations) - 1 if frame is None else frame
    seen, poses = observations[: last + 1], world_from_cam[: last + 1]
    ids, views = gather_views(seen)
    points = points_in_world[ids]
    _, j_pose, j_point = residuals_and_jacobians(projection, poses, points, views)
    by_track = np.argsort(np.concatenate([o.track_ids for o in seen]), kind="stable")
    j = np.concatenate([j_pose, j_point, np.concatenate([_rig_effects(o) for o in seen])[by_track]], axis=2)
    white = np.swapaxes(np.linalg.cholesky(views.information), 1, 2) @ j
    first = (np.diff(views.point, prepend=-1) != 0)[:, None, None]
    scale = 1 / np.sqrt(1 - autocorrelation**2)
    now = np.where(first, 1.0, scale) * white
    before = np.where(first, 0.0, -scale * autocorrelation * np.roll(white, 1, axis=0))
    reduced = _reduced(last, len(ids), views, now, before)
    in_view = np.flatnonzero(np.isin(ids, seen[last].track_ids))
    covariances = reduced.covariances(in_view)
    in_cam = se3.transform(se3.inverse(poses[last]), points[in_view])
    return Bound(
        cov_poses=np.stack([covariances.cov_pose(k) for k in range(last + 1)]),
        track_ids=ids[in_view],
        cov_points_in_world=covariances.cov_points,
        cov_points_in_cam=covariances.cov_points_in_cam(last, poses[last], in_cam),
    )


def _rig_effects(observations: Observations) -> Array:
    if observations.rig is None:
        return np.zeros((len(observations.track_ids), 4, 0))
    return observations.rig.model.effects(observations.z_px)[..., : len(LENS_TERMS)]


def _reduced(last: int, points: int, views: WeightedViews, now: Array, before: Array) -> Reduced:
    """Return the information about poses 1 … `last` and the rig's m errors, from whitened rows (k, 4, 9 + m).

    Their columns are pose, point and rig: `now` of the view itself, `before` of the previous view of its track.
    """
    rig = now.shape[2] - 9
    size = 6 * last + rig
    u, w, v = np.zeros((size, size)), np.zeros((points, 3, size)), np.zeros((points, 3, 3))
    u[6 * last :, 6 * last :] = np.eye(rig)
    for n in range(last + 1):
        of_frame = views.frame == n
        shared = now[of_frame] + before[of_frame]
        columns = np.concatenate([np.arange(6 * n - 12, 6 * n), np.arange(6 * last, size)])
        j = np.concatenate([before[of_frame, :, :6], now[of_frame, :, :6], shared[..., 9:]], axis=2)
        j, columns = j[..., columns >= 0], columns[columns >= 0]  # the first pose is fixed
        by_point, point = np.swapaxes(shared[..., 6:9], 1, 2), views.point[of_frame]
        flat = j.reshape(4 * len(j), len(columns))
        u[np.ix_(columns, columns)] += flat.T @ flat
        v[point] += by_point @ shared[..., 6:9]
        w[point[:, None, None], np.arange(3)[:, None], columns] += by_point @ j
    return Reduced.eliminate(np.arange(last + 1) > 0, u, w, v, np.zeros(size), np.zeros((points, 3)))
