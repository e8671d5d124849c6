"""Baseline: the motion between two frames, over and over. Each pair is solved to its maximum likelihood.

Both views of a pair are noisy measurements (points are unknowns, not exact), and the motions are concatenated, eq.
(5); the covariance is composed as if pairs were independent, though neighbours share a frame.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from ...config import Config
from ...geometry import se3
from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection
from ...types import Observations, Solution, Status
from .. import lifecycle as outcome
from ..motion_model import MotionPrior, robust_start
from ..triangulation import compose_cov, points_to_world, triangulated, usable_births
from .bundle_adjustment import Covariances, NormalEquations, Views, adjust

_FREE = np.array([False, True])  # the previous camera is the reference, the current one moves


class FrameToFrame:
    """Two-frame motion and structure, concatenated."""

    name = "frame-to-frame"

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        self._projection = projection
        self._config = config
        self._motion = MotionPrior(config.motion)
        self._previous: Observations | None = None  # None: no map (at the start, and while lost)
        self._world_from_previous = np.eye(4)
        self._cov_previous = np.zeros((6, 6))
        self._structure: outcome.Ended = outcome.NO_ENDED  # the last frame's points, in the world

    def step(self, observations: Observations) -> Solution:
        """Take the next frame; see types.Estimator."""
        obs = observations
        if self._previous is None:
            return self._start(obs)
        before = self._previous
        shared, row_before, row_now = np.intersect1d(before.track_ids, obs.track_ids, True, True)
        usable = usable_births(self._projection, before.z_px[row_before], before.cov_px[row_before])
        shared, row_before, row_now = shared[usable], row_before[usable], row_now[usable]
        z = np.stack([before.z_px[row_before], obs.z_px[row_now]])
        cov = np.stack([before.cov_px[row_before], obs.cov_px[row_now]])
        points, cov_points = triangulated(self._projection, z[0], cov[0])
        predicted, cov_predicted = self._motion.predict(obs.stamp_ns)
        starts = [se3.inverse(predicted) @ self._world_from_previous, np.eye(4)]
        if obs.cam_from_previous is not None:
            starts.insert(0, obs.cam_from_previous)
        robust = self._config.robust
        found = robust_start(
            self._projection, points, cov_points, z[1], cov[1], starts, robust.gate_probability, robust.min_views
        )
        if found is None:
            reason = outcome.few_views(0, len(shared), robust)
            return self._lost(obs, reason, predicted, cov_predicted)
        kept = found.accepted
        pair = self._adjust(found.cam_from_ref, points, z, cov, kept)
        if pair is None:
            reason = outcome.few_views(int(kept.sum()), len(shared), robust)
            return self._lost(obs, reason, predicted, cov_predicted)
        kept, poses, points, covariances, nis, iterations = pair
        world_from_cam = se3.orthonormalise(self._world_from_previous @ poses[1])
        cov_pose = compose_cov(self._cov_previous, poses[1], covariances.cov_pose(1))
        in_cam = se3.transform(se3.inverse(poses[1]), points)
        cov_in_cam = covariances.cov_points_in_cam(1, poses[1], in_cam)
        in_world, cov_in_world = points_to_world(
            self._world_from_previous, self._cov_previous, points, covariances.cov_points
        )
        births = usable_births(self._projection, obs.z_px, obs.cov_px)
        new = births & ~np.isin(obs.track_ids, shared)
        new_in_cam, new_cov = triangulated(self._projection, obs.z_px[new], obs.cov_px[new])
        new_in_world, new_cov_world = points_to_world(world_from_cam, cov_pose, new_in_cam, new_cov)
        ids = np.concatenate([shared[kept], obs.track_ids[new]])
        order = np.argsort(ids)
        self._motion.record(obs.stamp_ns, world_from_cam, cov_pose)
        self._previous, window = obs, np.stack([self._world_from_previous, world_from_cam])
        self._world_from_previous, self._cov_previous = world_from_cam, cov_pose
        status, reason = outcome.status_of(int(kept.sum()), obs.note, robust)
        now = (
            ids[order],
            np.concatenate([in_world, new_in_world])[order],
            np.concatenate([cov_in_world, new_cov_world])[order],
        )
        ended = self._hand_over(obs, now)
        return Solution(
            status=status,
            reason=reason,
            world_from_cam=world_from_cam,
            cov_pose=cov_pose,
            track_ids=now[0],
            points_in_cam=np.concatenate([in_cam, new_in_cam])[order],
            cov_points=np.concatenate([cov_in_cam, new_cov])[order],
            points_in_world=now[1],
            cov_points_in_world=now[2],
            window_frame_indices=np.array([before.frame_index, obs.frame_index], np.int64),
            window_world_from_cam=window,
            rejected_ids=shared[~kept],
            ended_ids=ended[0],
            ended_points_in_world=ended[1],
            ended_cov_points_in_world=ended[2],
            iterations=iterations,
            nis=nis[0],
            nis_dof=nis[1],
        )

    def _adjust(
        self, cam_from_previous: Array, points: Array, z: Array, cov: Array, kept: NDArray[np.bool_]
    ) -> tuple[NDArray[np.bool_], Array, Array, Covariances, tuple[float, int], int] | None:
        """Maximum likelihood of the pair, gated once by each point's residual; None with too few points left."""
        poses = np.stack([np.eye(4), se3.inverse(cam_from_previous)])
        for last in (False, True):
            n = int(kept.sum())
            if n < self._config.robust.min_views:
                return None
            index = np.arange(n)
            views = Views.sorted_by_point(
                np.repeat([0, 1], n), np.tile(index, 2), z[:, kept].reshape(-1, 4), cov[:, kept].reshape(-1, 4, 4)
            )
            result = adjust(self._projection, poses, points[kept], views, _FREE, max_iterations=10)
            dof = np.isfinite(z[:, kept]).sum(axis=(0, 2)) - 3
            chi2 = result.share.reshape(n, 2).sum(axis=1)
            good = chi2 < chdtri(dof, 1 - self._config.robust.gate_probability)
            poses = result.ref_from_cam
            if last or good.all():
                break
            kept = kept.copy()
            kept[np.flatnonzero(kept)[~good]] = False
        normal = NormalEquations.build(self._projection, poses, result.points, views)
        covariances = Covariances.of(normal.eliminate_points(_FREE), _FREE)
        return kept, poses, result.points, covariances, (float(chi2.sum()), int(dof.sum()) - 6), result.iterations

    def _start(self, obs: Observations) -> Solution:
        solution = outcome.open_map(self._projection, self._config.robust, self._motion, obs)
        if solution.status is Status.INITIALISING:
            self._previous = obs
            self._world_from_previous, self._cov_previous = solution.world_from_cam, solution.cov_pose
            self._structure = (solution.track_ids, solution.points_in_world, solution.cov_points_in_world)
        return solution

    def _lost(self, obs: Observations, reason: str, pose: Array, cov_pose: Array) -> Solution:
        ended, self._structure, self._previous = self._structure, outcome.NO_ENDED, None
        return outcome.solution_without_points(obs, Status.LOST, reason, pose, cov_pose, ended)

    def _hand_over(self, obs: Observations, now: outcome.Ended) -> outcome.Ended:
        """Keep the structure as of this frame; return what is no longer tracked."""
        ids, points, covs = self._structure
        tracked, refreshed = np.isin(ids, obs.track_ids), np.isin(ids, now[0])
        keep = tracked & ~refreshed  # rejected in this frame: it may come back
        self._structure = outcome.joined([now, (ids[keep], points[keep], covs[keep])])
        return ids[~tracked], points[~tracked], covs[~tracked]
