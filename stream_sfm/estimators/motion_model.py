"""The motion model: constant velocity, with an uncertainty that grows by an assumed acceleration, eqs. (42) and (43).

Its prediction is where the estimate of every frame starts, and it is the estimate itself while lost.
"""

from copy import copy
from typing import NamedTuple

import numpy as np

from ..config import MotionConfig
from ..geometry import Array, se3


class Displaced(NamedTuple):
    """Images that are displaced as by a turn by `turn_rad`, of a scene at `depth_m`."""

    turn_rad: float = 0.0
    depth_m: float = 0.0

    def cov_of(self, motion: Array) -> Array:
        """Return the covariance (6, 6) of a motion (4, 4) that such images show: its axes are turned by that angle, and
        from afar a turn that they show wrongly looks like a step aside."""
        xi = se3.log(motion)
        moved_m, turned_rad = np.linalg.norm(xi[:3]), np.linalg.norm(xi[3:])
        std = self.turn_rad * np.repeat([moved_m + self.depth_m * turned_rad, turned_rad], 3)
        return np.diag(std**2)


_NOT_DISPLACED = Displaced()


class Doubts(NamedTuple):
    """Why a pose may be wrong.

    `misfit`: the pose may be the one that the last pose without a misfit predicts. `of_start`: it may be the one that
    the first pose of the map predicts. `unconfirmed`: the start was over before its doubt was settled. `stepped`: both
    images were displaced before it, and the camera may have moved with them or not. `may_step`: they may have been
    displaced since the last pose; the next one shows it.
    """

    misfit: bool = False
    of_start: bool = False
    unconfirmed: bool = False
    stepped: Displaced | None = None
    may_step: bool = False


NO_DOUBTS = Doubts()


class MotionModel:
    """The last estimated pose, its covariance, and the velocity that led to it. Frames come in order of time."""

    def __init__(self, config: MotionConfig) -> None:
        self._config, self._std_acceleration = config, np.array(config.std_acceleration)
        self._pose = np.eye(4)
        self._cov = np.zeros((6, 6))
        self._stamp_ns: int | None = None
        self._velocity = np.zeros(6)  # ξ per second, in the camera's own axes
        self._velocity_known = False
        # Of steps of both images, and of doubts that nothing has settled: the pose after each, the covariance left, and
        # what images show since.
        self._left: list[tuple[Array, Array, Displaced]] = []
        self._known_at_ns: int | None = None  # when the velocity was measured last; until it was, the first pose
        self._trusted: MotionModel | None = None  # as it was before the doubtful frames up to the latest one
        self._at_start: MotionModel | None = None  # as it was when the map began
        self._covered: tuple[Array, Array] | None = (
            None  # a pose since a doubtful start, and what covers that doubt
        )

    @property
    def started(self) -> bool:
        """Whether any pose was added."""
        return self._stamp_ns is not None

    @property
    def std_speed(self) -> Array:
        """σ (6,) of how far velocities of a vehicle are apart, per second: what it builds up while it speeds up."""
        return np.asarray(self._config.speeds_up_s * self._std_acceleration)

    def add(
        self,
        stamp_ns: int,
        world_from_cam: Array,
        cov_pose: Array,
        doubts: Doubts = NO_DOUBTS,
    ) -> Array:
        """Take the estimated pose of a frame and the velocity that it implies, and return its covariance (6, 6).

        A doubtful pose is followed, and its covariance covers where it may be as well, eq. (43a). What covers a doubt
        of the start stays in all later poses where that ends unconfirmed. By how much a camera has moved with images
        that stepped is what the model does not explain; it stays in all later poses, also where the images step back.
        """
        if doubts.stepped is not None:
            if doubts.misfit:  # images that do not fit each other do not show the step, either
                covering = (self._trusted or self)._covering(stamp_ns, world_from_cam)
            else:
                covering = self._step_into(stamp_ns, world_from_cam)
            self._leave(world_from_cam, covering, doubts.stepped)
        if doubts.unconfirmed and self._covered is not None:
            self._leave(*self._covered)
        cov_pose = self._with_left(world_from_cam, cov_pose)
        if doubts.may_step:
            cov_pose = cov_pose + self._step_into(stamp_ns, world_from_cam)
        if not doubts.misfit:
            self._trusted = self._covered = None
        else:
            since = self._at_start if doubts.of_start else None
            self._trusted = since or self._trusted or copy(self)
            covering = self._trusted._covering(stamp_ns, world_from_cam)
            self._covered = (world_from_cam, covering) if doubts.of_start else None
            cov_pose = cov_pose + covering
        dt = self._seconds_since(stamp_ns)
        if dt > 0:
            self._velocity = se3.log(se3.inverse(self._pose) @ world_from_cam) / dt
            self._velocity_known = True
            self._known_at_ns = stamp_ns
        self._go_on(stamp_ns, world_from_cam, cov_pose)
        return cov_pose

    def restart(self, stamp_ns: int, world_from_cam: Array, cov_pose: Array) -> None:
        """Take the pose at which a new map begins; the velocity stays as it is, and as old as it is.

        Earlier steps of the images and doubts are in its covariance, which all poses of the map have.
        """
        self._left, self._trusted, self._covered = [], None, None
        self._go_on(stamp_ns, world_from_cam, cov_pose)
        self._at_start = None
        self._at_start = copy(self)

    def _go_on(self, stamp_ns: int, world_from_cam: Array, cov_pose: Array) -> None:
        self._pose, self._cov, self._stamp_ns = world_from_cam, cov_pose, stamp_ns
        if self._known_at_ns is None:
            self._known_at_ns = stamp_ns

    def jump(self) -> None:
        """Take it that the camera has left its last pose in a way that no velocity explains."""
        self._velocity, self._velocity_known = np.zeros(6), False
        reach_s2 = self._config.speeds_up_s * (0.5 * self._config.speeds_up_s + self._config.build_up_s)
        self._cov = self._cov + np.diag((reach_s2 * self._std_acceleration) ** 2)

    def _step_into(self, stamp_ns: int, world_from_cam: Array) -> Array:
        """Return the covariance (6, 6) of a pose that may be off by what the model does not explain of it."""
        step = se3.log(se3.inverse(self.predict(stamp_ns)[0]) @ world_from_cam)
        return np.outer(step, step)

    def _leave(self, world_from_cam: Array, cov: Array, displaced: Displaced = _NOT_DISPLACED) -> None:
        """Keep a covariance (6, 6) of a pose in all later ones, and what `displaced` images show since.

        The latest 16 are kept, so that a stream that is displaced all the time is bounded.
        """
        self._left = [*self._left, (world_from_cam, cov, displaced)][-16:]

    def _with_left(self, world_from_cam: Array, cov_pose: Array) -> Array:
        """Return the covariance (6, 6) of a pose that goes on from where steps and doubts have left theirs."""
        for pose, cov, displaced in self._left:
            cam_from_pose = se3.inverse(world_from_cam) @ pose
            ad = se3.adjoint(cam_from_pose)
            cov_pose = cov_pose + ad @ cov @ ad.T + displaced.cov_of(cam_from_pose)
        return cov_pose

    def _covering(self, stamp_ns: int, world_from_cam: Array) -> Array:
        """Return the covariance (6, 6) by which a pose may as well be where the model predicts it, eq. (43a)."""
        predicted, cov = self.predict(stamp_ns)
        pose_from_predicted = se3.inverse(world_from_cam) @ predicted
        ad, apart = se3.adjoint(pose_from_predicted), se3.log(pose_from_predicted)
        return np.asarray(ad @ cov @ ad.T + np.outer(apart, apart))

    def predict(self, stamp_ns: int) -> tuple[Array, Array]:
        """Predict pose (4, 4) and covariance (6, 6) at a later time, eqs. (42) and (43).

        Before the first frame this is the world's origin, exactly. Where the last pose is doubtful, so is the velocity.
        """
        dt = self._seconds_since(stamp_ns)
        step = se3.exp(self._velocity * dt)
        ad = se3.adjoint(se3.inverse(step))
        time = np.sqrt(max(self._reach_s2(stamp_ns) ** 2 - self._reach_s2(self._stamp_ns) ** 2, 0.0))
        std = self._std_acceleration * time
        predicted, cov = se3.orthonormalise(self._pose @ step), ad @ self._cov @ ad.T + np.diag(std**2)
        return predicted, cov if self._trusted is None else cov + self._trusted._covering(stamp_ns, predicted)

    def _reach_s2(self, stamp_ns: int | None) -> float:
        """Displacement that an acceleration of one has built up at a time since the velocity was last measured, s²."""
        if stamp_ns is None or self._known_at_ns is None:
            return 0.0
        age_s = (stamp_ns - self._known_at_ns) / 1e9
        speeding_up_s = min(age_s, self._config.speeds_up_s)
        built_up_s = 0.0 if self._velocity_known else self._config.build_up_s
        return (age_s - 0.5 * speeding_up_s) * speeding_up_s + age_s * built_up_s

    def _seconds_since(self, stamp_ns: int) -> float:
        return 0.0 if self._stamp_ns is None else max(0, stamp_ns - self._stamp_ns) / 1e9
