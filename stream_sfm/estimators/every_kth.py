"""Estimates every k-th frame with any method, and places the frames between by resection: track all, estimate few.

What an estimate gains from a frame grows with the distance that the camera has moved, its cost does not; tracks on the
other hand are best followed in every frame (the paper's set-up). The method sees every k-th frame as if there were no
others. A frame between gets the pose at which the local structure of the last estimate is seen, and that structure.
"""

from dataclasses import replace

import numpy as np

from .. import core
from ..config import Config
from ..geometry import se3
from ..geometry.linear import symmetric
from ..geometry.resection import Resection
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection, clamp_depth
from ..types import (
    Estimator,
    ExpectedMotion,
    InertialEstimator,
    InertialView,
    Observations,
    Prediction,
    Solution,
    Status,
)
from .initial_motion import initial_motion
from .lifecycle import WorldPoints, frame_status, solution_of
from .triangulation import compose_cov


class EveryKth:
    """Passes every k-th frame to `estimator`, and every frame while that has no map."""

    def __init__(self, estimator: Estimator, projection: StereoProjection, config: Config) -> None:
        self.name = estimator.name
        self._estimator = estimator
        self._projection = projection
        self._config = config
        self._last: Solution | None = None  # of the method
        self._last_ns = 0  # its stamp
        self._newest_id = -1  # that the method has seen
        self._begin_interval()

    def _begin_interval(self) -> None:
        """Forget what has come together since a frame of the method, which is the latest one."""
        self._between = 0  # frames since then
        self._previous_from_last = np.eye(4)  # motion from the method's last frame to the previous one
        self._drift_ids, self._var_drift_px, self._var_turn_rad2 = np.empty(0, np.int64), np.empty(0), 0.0
        self._rig_change_roots: list[Array] = []
        self._settled = False

    def step(self, observations: Observations) -> Solution:
        """Take the next frame; see `Estimator.step`."""
        self._accumulate(observations)
        self._between += 1
        since, last = self._since_last(observations), self._last
        if last is not None and self._between < self._config.estimate_every:
            placed = self._placed(last, since)
            if placed is not None:
                return placed
        solution = self._estimator.step(since)
        self._last, self._last_ns = None if solution.status is Status.LOST else solution, observations.stamp_ns
        if len(observations.track_ids):
            self._newest_id = int(observations.track_ids[-1])
        self._begin_interval()
        return solution

    @property
    def inertial_problem(self) -> str:
        """Why inertial samples are not used; see `InertialEstimator`."""
        return self._estimator.inertial_problem if isinstance(self._estimator, InertialEstimator) else ""

    def expect(self, stamp_ns: int, view: InertialView | None) -> ExpectedMotion | None:
        """Let the method take inertial samples; its prediction is from its own last frame, see `InertialEstimator`."""
        return self._estimator.expect(stamp_ns, view) if isinstance(self._estimator, InertialEstimator) else None

    def predict(self, stamp_ns: int, view: InertialView | None) -> Prediction | None:
        """Return what the method predicts, see `InertialEstimator`."""
        return self._estimator.predict(stamp_ns, view) if isinstance(self._estimator, InertialEstimator) else None

    def _accumulate(self, observations: Observations) -> None:
        """Add the drift of this frame, and a change of the rig, to those since the method's last frame."""
        if observations.rig is not None and observations.rig.change_root is not None:
            self._rig_change_roots.append(observations.rig.change_root)
        self._settled |= observations.settled
        if observations.lasting.std_drift_px is None:
            return
        self._var_turn_rad2 += observations.lasting.std_turn_rad**2
        variances = observations.lasting.std_drift_px**2
        _, now, before = np.intersect1d(observations.track_ids, self._drift_ids, return_indices=True)
        variances[now] += self._var_drift_px[before]
        self._drift_ids, self._var_drift_px = observations.track_ids, variances

    def _since_last(self, observations: Observations) -> Observations:
        """Return the observations with motion, drift and new tracks since the method's last frame."""
        if self._between == 1:
            return observations
        rig, lasting, motion = observations.rig, observations.lasting, observations.cam_from_previous
        if motion is not None:
            motion = se3.orthonormalise(motion @ self._previous_from_last)
        if rig is not None:
            roots = self._rig_change_roots
            rig = replace(rig, change_root=np.concatenate(roots, axis=1) if roots else None)
        if lasting.std_drift_px is not None:
            of_turn = float(np.sqrt(self._var_turn_rad2))
            lasting = replace(lasting, std_drift_px=np.sqrt(self._var_drift_px), std_turn_rad=of_turn)
        return replace(
            observations,
            cam_from_previous=motion,
            n_new=int((observations.track_ids > self._newest_id).sum()),
            lasting=lasting,
            rig=rig,
            settled=self._settled,
        )

    def _unknown_px(self, last: Solution, since: Observations, points: Array) -> Array | None:
        """Return what is not known of what timing does to views of points (n, 3): (n, 4, j) px of σ = 1, as a map does.

        None where nothing is.
        """
        dt_s, motion = (since.stamp_ns - self._last_ns) / 1e9, since.cam_from_previous
        if since.rig is None or last.rig is None or motion is None or dt_s <= 0:
            return None
        model, twist = since.rig.model, se3.log(motion) / dt_s
        before = np.column_stack([points, np.ones(len(points))])
        return core.timing_unknowns(
            *model.cameras,
            (before, twist),
            (clamp_depth(before @ motion.T), twist),
            *model.timing(last.rig.mean, last.rig.cov),
            np.array(self._config.motion.std_acceleration) * dt_s,
        )

    def _placed(self, last: Solution, since: Observations) -> Solution | None:
        """The map of the last estimate, seen from a frame between; None where too few of its points agree."""
        _, rows, known = np.intersect1d(since.track_ids, last.track_ids, return_indices=True)
        if len(rows) < self._config.robust.min_inliers:
            return None
        found = initial_motion(
            self._projection,
            self._config.robust,
            replace(since, z_px=_without_rig_error(since, last)),
            rows,
            last.points_in_cam[known],
            last.cov_points[known],
            self._previous_from_last,
            shared=self._unknown_px(last, since, last.points_in_cam[known]),
        )
        if found is None:
            return None
        self._previous_from_last = found.cam_from_ref
        known, rejected = known[found.accepted], since.track_ids[rows[~found.accepted]]
        last_from_cam = se3.inverse(found.cam_from_ref)
        world_from_cam = se3.orthonormalise(last.world_from_cam @ last_from_cam)
        in_cam = WorldPoints(
            last.track_ids[known], *_seen_from(found, last.points_in_cam[known], last.cov_points[known])
        )
        in_world = se3.transform(world_from_cam, in_cam.points)
        return solution_of(
            since,
            frame_status(int(found.accepted.sum()), since.note, self._config.robust, found),
            world_from_cam,
            compose_cov(last.cov_pose, last_from_cam, found.cov_pose),
            in_cam,
            WorldPoints(in_cam.ids, in_world, last.cov_points_in_world[known]),
            rejected_ids=rejected,
            nis=found.chi2,
            nis_dof=found.dof,
            rig=last.rig,
        )


def _seen_from(found: Resection, points: Array, cov: Array) -> tuple[Array, Array]:
    """Points (n, 3) with covariances in the camera of a resection, whose own uncertainty counts, eq. (45)."""
    in_cam = se3.transform(found.cam_from_ref, points)
    r, j = found.cam_from_ref[:3, :3], se3.point_in_source_jacobian(in_cam)
    return in_cam, symmetric(r @ cov @ r.T + j @ found.cov_pose @ np.swapaxes(j, 1, 2))


def _without_rig_error(observations: Observations, last: Solution) -> Array:
    """Return the views without the errors of the rig that the method has found, and without what its timing does.

    A map's first frame, and its points, have both: how its views moved was not known.
    """
    if observations.rig is None or last.rig is None:
        return observations.z_px
    at_rest = observations.rig.model.error_px(last.rig, observations.z_px)
    return observations.z_px - observations.rig.timing_px - at_rest
