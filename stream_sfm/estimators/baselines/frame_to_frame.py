"""Baseline: concatenated motions between two frames, each the maximum-likelihood estimate of its pair.

Both views of a pair are noisy measurements (points are unknowns, not exact), and the motions are concatenated, eq. (5).
Consecutive pairs share a frame, whose noise affects both motions; the covariance includes this correlation.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from ...geometry import Array, se3
from ...geometry.linear import symmetric
from ...types import Observations, Solution
from ..lifecycle import LostError, WorldPoints, frame_status, solution_of, too_few_inliers
from ..triangulation import compose_cov, points_to_world, triangulate, usable_births
from .baseline import Baseline
from .bundle_adjustment import Covariances, Problem, Reduced, WeightedViews, residuals_and_jacobians

_FREE = np.array([False, True])  # the previous camera is the reference, the current one is estimated


class _Shared(NamedTuple):
    """Views (2, n, 4), previous and current, of points that the previous frame can locate and the current one sees.

    `rows` (n,): rows of the current observations; points (n, 3) in the previous camera, triangulated there.
    """

    ids: NDArray[np.int64]
    rows: NDArray[np.intp]
    z_px: Array
    cov_px: Array
    points: Array
    cov_points: Array


class _Gains(NamedTuple):
    """Jacobians of a pair's estimates by the noise of its views; points have ascending ids (n,).

    `of_previous`, `of_current` (n, 6, 4): ∂ξ/∂z of the motion by the views of either frame; `of_point` (n, 3, 4): ∂X/∂z
    of a point by its own previous view with the motion fixed; `y` (n, 3, 6): with the motion the point moves by −y ξ.
    """

    ids: NDArray[np.int64]
    of_previous: Array
    of_current: Array
    of_point: Array
    y: Array


class _Pair(NamedTuple):
    """The adjusted pair: the pose, the mask `kept` (n,) of shared points, and these points in the previous camera."""

    kept: NDArray[np.bool_]
    previous_from_cam: Array
    points: Array
    covariances: Covariances
    gains: _Gains
    nis: float
    dof: int
    iterations: int


class FrameToFrame(Baseline):
    """Two-frame motion and structure, concatenated."""

    def _begin(self, obs: Observations, first: Solution) -> WorldPoints:
        self._previous = obs
        self._world_from_previous, self._cov_previous = first.world_from_cam, first.cov_pose
        self._gains: _Gains | None = None  # of the pair that ends with the previous frame
        return WorldPoints(first.track_ids, first.points_in_world, first.cov_points_in_world)

    def _advance(self, obs: Observations, before: WorldPoints) -> tuple[Solution, WorldPoints]:
        shared = self._shared(self._previous, obs)
        found = self._initial_motion(obs, shared.rows, shared.points, shared.cov_points, self._world_from_previous)
        pair = self._adjust(found.cam_from_ref, shared, found.accepted)
        return self._concatenated(obs, shared, pair, before)

    def _shared(self, before: Observations, obs: Observations) -> _Shared:
        ids, row_before, row_now = np.intersect1d(before.track_ids, obs.track_ids, True, True)
        usable = usable_births(self._projection, before.z_px[row_before], before.cov_px[row_before])
        ids, row_before, row_now = ids[usable], row_before[usable], row_now[usable]
        z = np.stack([before.z_px[row_before], obs.z_px[row_now]])
        cov = np.stack([before.cov_px[row_before], obs.cov_px[row_now]])
        return _Shared(ids, row_now, z, cov, *triangulate(self._projection, z[0], cov[0]))

    def _adjust(self, cam_from_previous: Array, shared: _Shared, kept: NDArray[np.bool_]) -> _Pair:
        """Maximise the likelihood of the pair, gated once by the residual of each point.

        Raises LostError if too few points are left.
        """
        poses, robust = np.stack([np.eye(4), se3.inverse(cam_from_previous)]), self._robust
        accepted = int(kept.sum())
        for last in (False, True):
            n = int(kept.sum())
            if n < robust.min_inliers:
                raise LostError(too_few_inliers(accepted, len(shared.ids), robust))
            z, cov = shared.z_px[:, kept], shared.cov_px[:, kept]
            views = WeightedViews.sorted_by_point(
                np.repeat([0, 1], n), np.tile(np.arange(n), 2), z.reshape(-1, 4), cov.reshape(-1, 4, 4)
            )
            problem = Problem(self._projection, views, _FREE)
            # measured: five to eight iterations are needed with 1 px of noise
            result = problem.minimum(poses, shared.points[kept], max_iterations=10)
            dof = np.isfinite(z).sum(axis=(0, 2)) - 3
            chi2 = result.squares.reshape(n, 2).sum(axis=1)
            good = chi2 < chdtri(dof, 1 - robust.gate_probability)
            poses = result.ref_from_cam
            if last or good.all():
                break
            kept = kept.copy()
            kept[np.flatnonzero(kept)[~good]] = False
        reduced = problem.linearised(poses, result.points)
        covariances = reduced.covariances()
        _, j_pose, j_point = residuals_and_jacobians(self._projection, poses, result.points, views)
        gains = _gains(shared.ids[kept], covariances.cov_pose(1), reduced, j_pose, j_point, views.information)
        nis, nis_dof = float(chi2.sum()), int(dof.sum()) - 6
        return _Pair(kept, poses[1], result.points, covariances, gains, nis, nis_dof, result.iterations)

    def _concatenated(
        self, obs: Observations, shared: _Shared, pair: _Pair, before: WorldPoints
    ) -> tuple[Solution, WorldPoints]:
        """Concatenate the motion, merge the pair's points with the new ones, and prepare the next pair."""
        previous_from_cam, covariances = pair.previous_from_cam, pair.covariances
        world_from_cam = se3.orthonormalise(self._world_from_previous @ previous_from_cam)
        with_motion, with_points = self._shared_noise(pair.gains, shared.cov_px[0, pair.kept])
        cov_pose = compose_cov(self._cov_previous, previous_from_cam, covariances.cov_pose(1))
        mixed = se3.adjoint(se3.inverse(previous_from_cam)) @ with_motion
        cov_pose = symmetric(cov_pose + mixed + mixed.T)
        in_cam = se3.transform(se3.inverse(previous_from_cam), pair.points)
        cov_in_cam = covariances.cov_points_in_cam(1, previous_from_cam, in_cam)
        in_world, cov_in_world = points_to_world(
            self._world_from_previous, self._cov_previous, pair.points, covariances.cov_points
        )
        r = self._world_from_previous[:3, :3]
        mixed = r @ -se3.point_in_source_jacobian(pair.points) @ with_points @ r.T
        cov_in_world = symmetric(cov_in_world + mixed + np.swapaxes(mixed, 1, 2))
        births = usable_births(self._projection, obs.z_px, obs.cov_px) & ~np.isin(obs.track_ids, shared.ids)
        new = triangulate(self._projection, obs.z_px[births], obs.cov_px[births])
        ids, new_ids = shared.ids[pair.kept], obs.track_ids[births]
        local = WorldPoints.merge([WorldPoints(ids, in_cam, cov_in_cam), WorldPoints(new_ids, *new)])
        new = points_to_world(world_from_cam, cov_pose, *new)
        now = WorldPoints.merge([WorldPoints(ids, in_world, cov_in_world), WorldPoints(new_ids, *new)])
        solution = solution_of(
            obs,
            frame_status(int(pair.kept.sum()), len(pair.kept), obs.note, self._robust),
            world_from_cam,
            cov_pose,
            local,
            now,
            window_frame_indices=np.array([self._previous.frame_index, obs.frame_index], np.int64),
            window_world_from_cam=np.stack([self._world_from_previous, world_from_cam]),
            rejected_ids=shared.ids[~pair.kept],
            iterations=pair.iterations,
            nis=pair.nis,
            nis_dof=pair.dof,
        )
        self._previous, self._gains = obs, pair.gains
        self._world_from_previous, self._cov_previous = world_from_cam, cov_pose
        return solution, self._hand_over(before, obs, now)

    def _shared_noise(self, now: _Gains, cov_px: Array) -> tuple[Array, Array]:
        """Return the cross-covariances of the previous pose with this pair's motion (6, 6) and points (n, 6, 3).

        The same noise of views in the previous frame, `cov_px` (n, 4, 4), also affected the previous pose.
        """
        with_points = np.zeros((len(now.ids), 6, 3))
        if self._gains is None:
            return np.zeros((6, 6)), with_points
        _, before, rows = np.intersect1d(self._gains.ids, now.ids, return_indices=True)
        moved = self._gains.of_current[before] @ np.nan_to_num(cov_px[rows])
        with_motion = (moved @ np.swapaxes(now.of_previous[rows], 1, 2)).sum(axis=0)
        with_points[rows] = moved @ np.swapaxes(now.of_point[rows], 1, 2)
        return with_motion, with_points - with_motion @ np.swapaxes(now.y, 1, 2)

    def _hand_over(self, old: WorldPoints, obs: Observations, now: WorldPoints) -> WorldPoints:
        """Keep the structure of this frame, and return the points that are no longer tracked."""
        tracked, refreshed = np.isin(old.ids, obs.track_ids), np.isin(old.ids, now.ids)
        rejected = old.select(tracked & ~refreshed)  # in this frame only: they may come back
        self._structure = WorldPoints.merge([now, rejected])
        return old.select(~tracked)


def _gains(
    ids: NDArray[np.int64], cov_motion: Array, reduced: Reduced, j_pose: Array, j_point: Array, information: Array
) -> _Gains:
    """Differentiate the least-squares estimates of a pair; Jacobians (2n, 4, …) and information by point and frame."""
    n = len(ids)
    by_point = (np.swapaxes(j_point, 1, 2) @ information).reshape(n, 2, 3, 4)
    by_pose = (np.swapaxes(j_pose, 1, 2) @ information).reshape(n, 2, 6, 4)[:, 1]
    y = reduced.root @ reduced.reach
    through_points = np.swapaxes(y, 1, 2)
    return _Gains(
        ids,
        of_previous=-cov_motion @ through_points @ by_point[:, 0],
        of_current=cov_motion @ (by_pose - through_points @ by_point[:, 1]),
        of_point=reduced.root @ np.swapaxes(reduced.root, 1, 2) @ by_point[:, 0],
        y=y,
    )
