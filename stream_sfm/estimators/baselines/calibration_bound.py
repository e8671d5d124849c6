"""The bound on every estimator where errors last along tracks, and the rig's own errors are unknown, too.

An error that follows e_n = ρ e_n−1 + noise in units of its σ, eq. (76), is white again in the differences of successive
views of a track, eq. (77); these couple the poses of two neighbouring frames. The rig's errors c ~ N(0, I) move all
views by `Observations.rig`.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...camera.refinement import TERMS
from ...geometry import se3
from ...geometry.linear import symmetric, symmetric_inverse
from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection
from ...types import Observations
from .bundle_adjustment import Covariances, Reduced, residuals_and_jacobians
from .full_batch import Bound, gather_views


def bound_with_rig(
    projection: StereoProjection,
    observations: Sequence[Observations],
    world_from_cam: Array,
    points_in_world: Array,
    frame: int,
    autocorrelation: float,
) -> Bound:
    """Return the bound at `frame` from all views up to it, at the true poses (n, 4, 4) and points, eqs. (46), (77).

    `points_in_world` (p, 3) is indexed by track id; tracks have no gaps. `autocorrelation`: of a view's error with that
    of the view before. Of the observations ids, views, covariances and effects of the rig matter; those of an exact rig
    have none.
    """
    seen = observations[: frame + 1]
    ids, views = gather_views(seen)
    _, j_pose, j_point = residuals_and_jacobians(
        projection, world_from_cam[: frame + 1], points_in_world[ids], views
    )
    j_rig = np.concatenate([_effects(o) for o in seen])[
        np.argsort(np.concatenate([o.track_ids for o in seen]), kind="stable")
    ]
    white = np.swapaxes(np.linalg.cholesky(views.information), 1, 2)
    system = _System(frame, len(ids), j_rig.shape[2])
    first = np.diff(views.point, prepend=-1) != 0
    rows = white @ np.concatenate([j_pose, j_point, j_rig], axis=2)
    system.add(views.frame[first], views.point[first], rows[first])
    later = np.flatnonzero(~first)
    scale = 1 / np.sqrt(1 - autocorrelation**2)
    system.add(
        views.frame[later], views.point[later], scale * rows[later], -scale * autocorrelation * rows[later - 1]
    )
    free = np.arange(frame + 1) > 0
    now = np.flatnonzero(np.isin(ids, observations[frame].track_ids))
    covariances = Covariances.of(system.eliminate_points(), free, now)
    in_cam = se3.transform(se3.inverse(world_from_cam[frame]), points_in_world[ids[now]])
    return Bound(
        cov_poses=np.stack([covariances.cov_pose(k) for k in range(frame + 1)]),
        track_ids=ids[now],
        cov_points_in_world=covariances.cov_points,
        cov_points_in_cam=covariances.cov_points_in_cam(frame, world_from_cam[frame], in_cam),
    )


def _effects(observations: Observations) -> Array:
    if observations.rig is None:
        return np.zeros((len(observations.track_ids), 4, 0))
    return observations.rig.model.effects(observations.z_px)[..., : len(TERMS)]


class _System:
    """Information about poses of frames 1 … n and the rig's m errors, [6n + m], about points, and between them."""

    def __init__(self, frames: int, points: int, rig_errors: int) -> None:
        self._poses = 6 * frames
        size = self._poses + rig_errors
        self._h = np.zeros((size, size))
        self._h[self._poses :, self._poses :] = np.eye(rig_errors)
        self._v = np.zeros((points, 3, 3))
        self._w = np.zeros((points, 3, size))

    def add(
        self, frame: NDArray[np.intp], point: NDArray[np.intp], now: Array, before: Array | None = None
    ) -> None:
        """Add rows (k, 4, 9 + m), by pose, point and rig, of views in `frame`, and what the view before adds to them.

        The pose of frame 0 is held.
        """
        for n in np.unique(frame).tolist():
            of_frame = frame == n
            j = np.zeros((int(of_frame.sum()), 4, len(self._h)))
            shared = now[of_frame]
            if n > 0:
                j[..., 6 * n - 6 : 6 * n] = shared[..., :6]
            if before is not None:
                if n > 1:
                    j[..., 6 * n - 12 : 6 * n - 6] = before[of_frame][..., :6]
                shared = shared + before[of_frame]
            j[..., self._poses :] = shared[..., 9:]
            by_point = np.swapaxes(shared[..., 6:9], 1, 2)
            self._h += np.einsum("kci,kcj->ij", j, j, optimize=True)
            self._v[point[of_frame]] += by_point @ shared[..., 6:9]
            self._w[point[of_frame]] += by_point @ j

    def eliminate_points(self) -> Reduced:
        """Return the system of poses and rig alone; what it says of steps is 0."""
        v_inv = symmetric_inverse(self._v)
        y = v_inv @ self._w
        size = len(self._h)
        s = self._h - self._w.reshape(-1, size).T @ y.reshape(-1, size)
        return Reduced(symmetric(s), np.zeros(size), v_inv, y)
