"""What the Kalman filters over the pose and all visible points have in common: the course of a frame.

The state of a filter is six numbers of the pose and three per point, with one joint covariance. How it is written, and
how it is updated by the views of a frame, is what tells the filters apart.
"""

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...geometry import se3
from ...geometry.resection import Resection
from ...geometry.se3 import Array
from ...geometry.stereo import StereoProjection
from ...types import Observations, Solution, Status
from ..initial_motion import initial_motion
from ..lifecycle import WorldPoints, first_solution, frame_status, lost_solution, recorded, too_few_inliers
from ..motion_model import MotionModel


class Structure(NamedTuple):
    """The points (m,) of a Solution, in metres."""

    track_ids: NDArray[np.int64]
    points_in_cam: Array
    cov_points: Array
    points_in_world: Array
    cov_points_in_world: Array


class JointFilter(ABC):
    """A filter with a joint covariance of the pose and the visible points."""

    def __init__(self, projection: StereoProjection, config: Config) -> None:
        self._projection = projection
        self._config = config
        self._motion = MotionModel(config.motion)
        self._world_from_cam = np.eye(4)
        self._ids = np.empty(0, np.int64)
        self._cov = np.zeros((6, 6))  # (6 + 3m, 6 + 3m)

    def step(self, observations: Observations) -> Solution:
        """Take the next frame; see `Estimator.step`."""
        obs, robust = observations, self._config.robust
        if not len(self._ids):
            return self._start(obs)
        ended = self._drop(np.isin(self._ids, obs.track_ids))
        predicted, cov_predicted = self._motion.predict(obs.stamp_ns)
        rows = np.searchsorted(obs.track_ids, self._ids)
        if obs.lasting.std_drift_px is not None:  # part of the prediction, ahead of the gate
            self._let_drift(obs.lasting.std_drift_px[rows])
        found = self._initial_motion(obs, rows, predicted)
        if found is None:
            ended = WorldPoints.merge([ended, self._drop(np.zeros(len(self._ids), bool))])
            return lost_solution(obs, too_few_inliers(0, len(rows), robust), predicted, cov_predicted, ended)
        iterations = self._take(obs, rows, found, predicted)
        rejected = self._ids[~found.accepted]
        self._add(obs)
        status, reason = frame_status(int(found.accepted.sum()), obs.note, robust, found)
        points = self._structure()
        solution = Solution(
            status=status,
            reason=reason,
            world_from_cam=self._world_from_cam,
            cov_pose=self._cov[:6, :6].copy(),
            track_ids=points.track_ids,
            points_in_cam=points.points_in_cam,
            cov_points=points.cov_points,
            points_in_world=points.points_in_world,
            cov_points_in_world=points.cov_points_in_world,
            window_frame_indices=np.array([obs.frame_index], np.int64),
            window_world_from_cam=self._world_from_cam[None],
            rejected_ids=rejected,
            ended_ids=ended.ids,
            ended_points_in_world=ended.points,
            ended_cov_points_in_world=ended.cov_points,
            iterations=iterations,
            nis=found.chi2,
            nis_dof=found.dof,
        )
        return recorded(self._motion, obs, solution)

    def _start(self, obs: Observations) -> Solution:
        solution = first_solution(self._projection, self._config.robust, self._motion, obs)
        if solution.status is Status.INITIALISING:
            self._world_from_cam, self._cov = solution.world_from_cam, solution.cov_pose
            self._add(obs)
        return solution

    def _initial_motion(self, obs: Observations, rows: NDArray[np.intp], predicted: Array) -> Resection | None:
        """Find the motion since the previous camera, and the inliers, from the points as that camera knew them."""
        points, cov = self._in_previous()
        start = se3.inverse(predicted) @ self._world_from_cam
        return initial_motion(self._projection, self._config.robust, obs, rows, points, cov, start)

    def _insert(self, ids: NDArray[np.int64], joint: Array) -> NDArray[np.intp]:
        """Add points with the covariance of the whole state; return the order that sorts all points by their ids."""
        together = np.concatenate([self._ids, ids])
        order = np.argsort(together)
        rows = np.concatenate([np.arange(6), (6 + 3 * order[:, None] + np.arange(3)).ravel()])
        self._ids, self._cov = together[order], joint[np.ix_(rows, rows)]
        return order

    def _blocks(self) -> Array:
        """Covariances (m, 3, 3) of the points as the state has them."""
        m = len(self._ids)
        return self._cov[6:, 6:].reshape(m, 3, m, 3)[np.arange(m), :, np.arange(m), :]

    @abstractmethod
    def _drop(self, keep: NDArray[np.bool_]) -> WorldPoints:
        """Marginalise the points outside the mask, and return those that have a position in metres."""

    @abstractmethod
    def _let_drift(self, std_drift_px: Array) -> None:
        """Add the process noise of patches (m,) that slide over their surfaces, eq. (33)."""

    @abstractmethod
    def _in_previous(self) -> tuple[Array, Array]:
        """Points (m, 3), or homogeneous (m, 4), in the previous camera, with covariances."""

    @abstractmethod
    def _take(self, obs: Observations, rows: NDArray[np.intp], found: Resection, predicted: Array) -> int:
        """Update pose and points by the views that were accepted; return the number of iterations."""

    @abstractmethod
    def _add(self, obs: Observations) -> None:
        """Add the points that are new in this frame."""

    @abstractmethod
    def _structure(self) -> Structure:
        """The points as they are reported."""
