"""The motion model: constant velocity, with an uncertainty that grows by an acceleration, eqs. (42) to (43b).

The estimate of every frame starts from its prediction; while lost, the prediction is the estimate.
"""

from copy import copy
from typing import NamedTuple

import numpy as np

from ..config import MotionConfig
from ..geometry import Array, se3
from .accelerations import Accelerations


class Unreliable(NamedTuple):
    """Why a pose may be wrong.

    `misfit`: the true pose may be the one predicted from the last pose without a misfit. `of_start`: it may be the one
    predicted from the first pose of the map. `unconfirmed`: the start ended before anything confirmed it.
    """

    misfit: bool = False
    of_start: bool = False
    unconfirmed: bool = False


RELIABLE = Unreliable()


class MotionModel:
    """The last estimated pose, its covariance, and the velocity that led to it. Frames are added in order of time."""

    def __init__(self, config: MotionConfig) -> None:
        self._config, self._accelerations = config, Accelerations.of(np.array(config.std_acceleration))
        self._pose = np.eye(4)
        self._cov = np.zeros((6, 6))
        self._stamp_ns: int | None = None
        self._velocity = np.zeros(6)  # ξ per second, in the camera's own axes
        self._velocity_known = False
        # For each start that was never confirmed: the last pose of it, and the covariance that remains.
        self._left: list[tuple[Array, Array]] = []
        self._known_at_ns: int | None = None  # when the velocity was last measured, or else the first pose
        self._trusted: MotionModel | None = None  # as it was before the unreliable frames up to the latest one
        self._at_start: MotionModel | None = None  # as it was when the map began
        # A pose since an unreliable start, and what covers its other possible pose.
        self._covered: tuple[Array, Array] | None = None

    @property
    def started(self) -> bool:
        """Whether any pose has been added."""
        return self._stamp_ns is not None

    @property
    def std_speed(self) -> Array:
        """σ (6,) of the difference of two velocities of a vehicle, per second: what it gains while it accelerates."""
        return self._config.speeds_up_s * self._accelerations.assumed

    def add(self, stamp_ns: int, world_from_cam: Array, cov_pose: Array, unreliable: Unreliable = RELIABLE) -> Array:
        """Add the estimated pose of a frame and the velocity that it implies, and return its covariance (6, 6).

        A pose that may be wrong is used, and its covariance also covers the other possible pose, eq. (43a). If nothing
        has confirmed the start, what was added to its covariance stays in all later ones.
        """
        if unreliable.unconfirmed and self._covered is not None:
            self._left = [*self._left, self._covered][-16:]  # memory is bounded
        cov_pose = self._with_left(world_from_cam, cov_pose)
        if not unreliable.misfit:
            self._trusted = self._covered = None
        else:
            since = self._at_start if unreliable.of_start else None
            self._trusted = since or self._trusted or copy(self)
            covering = self._trusted._covering(stamp_ns, world_from_cam)
            self._covered = (world_from_cam, covering) if unreliable.of_start else None
            cov_pose = cov_pose + covering
        dt = self._seconds_since(stamp_ns)
        if dt > 0:
            self._velocity = se3.log(se3.inverse(self._pose) @ world_from_cam) / dt
            self._velocity_known = True
            self._known_at_ns = stamp_ns
        learnt = self._accelerations.interrupted() if unreliable.misfit else self._accelerations
        self._accelerations = learnt.after(stamp_ns, world_from_cam)
        self._go_on(stamp_ns, world_from_cam, cov_pose)
        return cov_pose

    def restart(self, stamp_ns: int, world_from_cam: Array, cov_pose: Array) -> None:
        """Set the pose at which a new map begins; the velocity and its age are kept.

        What unreliable starts have left is part of the covariance of this pose, which all poses of the map share.
        """
        self._left, self._trusted, self._covered = [], None, None
        self._accelerations = self._accelerations.interrupted().after(stamp_ns, world_from_cam)
        self._go_on(stamp_ns, world_from_cam, cov_pose)
        self._at_start = None
        self._at_start = copy(self)

    def _go_on(self, stamp_ns: int, world_from_cam: Array, cov_pose: Array) -> None:
        self._pose, self._cov, self._stamp_ns = world_from_cam, cov_pose, stamp_ns
        if self._known_at_ns is None:
            self._known_at_ns = stamp_ns

    def jump(self) -> None:
        """Assume that the camera has left its last pose in a way that no velocity explains."""
        self._velocity, self._velocity_known = np.zeros(6), False
        reach_s2 = self._config.speeds_up_s * (0.5 * self._config.speeds_up_s + self._config.build_up_s)
        self._cov = self._cov + np.diag((reach_s2 * self._accelerations.std) ** 2)

    def _with_left(self, world_from_cam: Array, cov_pose: Array) -> Array:
        """Return the covariance (6, 6) of a pose with those that unreliable starts have left."""
        for pose, cov in self._left:
            ad = se3.adjoint(se3.inverse(world_from_cam) @ pose)
            cov_pose = cov_pose + ad @ cov @ ad.T
        return cov_pose

    def _covering(self, stamp_ns: int, world_from_cam: Array) -> Array:
        """Return the covariance (6, 6) to add to a pose if the predicted one may be the true one, eq. (43a)."""
        predicted, cov = self.predict(stamp_ns)
        pose_from_predicted = se3.inverse(world_from_cam) @ predicted
        ad, apart = se3.adjoint(pose_from_predicted), se3.log(pose_from_predicted)
        return np.asarray(ad @ cov @ ad.T + np.outer(apart, apart))

    def predict(self, stamp_ns: int) -> tuple[Array, Array]:
        """Predict pose (4, 4) and covariance (6, 6) at a later time, eqs. (42) and (43).

        Before the first frame this is exactly the world's origin. If the last pose is unreliable, so is the velocity.
        """
        dt = self._seconds_since(stamp_ns)
        step = se3.exp(self._velocity * dt)
        ad = se3.adjoint(se3.inverse(step))
        time = np.sqrt(max(self._reach_s2(stamp_ns) ** 2 - self._reach_s2(self._stamp_ns) ** 2, 0.0))
        std = self._accelerations.std * time
        predicted, cov = se3.orthonormalise(self._pose @ step), ad @ self._cov @ ad.T + np.diag(std**2)
        return predicted, cov if self._trusted is None else cov + self._trusted._covering(stamp_ns, predicted)

    def _reach_s2(self, stamp_ns: int | None) -> float:
        """Displacement by a unit acceleration since the velocity was last measured, in s²."""
        if stamp_ns is None or self._known_at_ns is None:
            return 0.0
        age_s = (stamp_ns - self._known_at_ns) / 1e9
        speeding_up_s = min(age_s, self._config.speeds_up_s)
        built_up_s = 0.0 if self._velocity_known else self._config.build_up_s
        return (age_s - 0.5 * speeding_up_s) * speeding_up_s + age_s * built_up_s

    def _seconds_since(self, stamp_ns: int) -> float:
        return 0.0 if self._stamp_ns is None else max(0, stamp_ns - self._stamp_ns) / 1e9
