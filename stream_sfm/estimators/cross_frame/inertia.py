"""Inertia in the window estimator: samples to intervals, predictions between frames, and the reported state.

No initialisation is needed: velocity, gravity and biases begin with a large σ in the first frame that has samples, and
the samples are linear in them. The map estimates them together with its world (`inertial_window.py`).
"""

import logging
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from ...config import Config
from ...geometry import Array, se3
from ...geometry.linear import symmetric
from ...geometry.resection import Resection, SecondMotion
from ...inertial.buffer import SampleBuffer
from ...inertial.samples import ImuCalibration, ImuSamples
from ...inertial.state import ACCEL_BIAS, AXES, CLOCK, FIXED, GRAVITY, GYRO_BIAS, SCALE, STATE, VELOCITY
from ...record import changed
from ...types import ExpectedMotion, InertialEstimate, InertialView, Prediction, Solution, Status
from ..lifecycle import LostError
from ..motion_model import MotionModel
from .inertia_checks import Agreement, Densities, Jitter, distance2_of, impossible, likely
from .inertial_window import InertialWindow
from .interval import JOINT, Interval, Known, Transition, transition
from .map import Map
from .window_frame import WindowFrame

_LEAST_STD_SCALE = 1e-6  # keeps its variance above rounding


class NotTheCameraError(LostError):
    """The images of a new map contradict the samples, so they show a moving body."""


class Inertia:
    """The inertial knowledge of an estimator between frames; `now`: at the latest estimate, None before the first."""

    def __init__(self, config: Config) -> None:
        self._config, self._rig, self._rules = config.imu, config.rig, config.rules.inertia
        scale = _LEAST_STD_SCALE if config.rig.exact else max(config.rig.std_baseline, _LEAST_STD_SCALE)
        self._std_fixed = np.r_[scale, np.full(3, self._config.std_axes_rad), self._config.std_time_offset_s]
        self._calibration: ImuCalibration | None = None
        self._buffer = SampleBuffer(ImuCalibration())
        self._taken: ImuSamples | None = None  # the latest ones
        self.now: Known | None = None
        self._agreement, self._densities = Agreement(self._rules), Densities.begun(self._rules)
        self._jitter = Jitter(self._rules)
        self._noise_known = False  # from the samples themselves
        self._distance2, self._note = 0.0, ""
        self._frames = config.window.frames
        self._led: tuple[tuple[Any, ...], Transition] | None = None  # the latest one, and its arguments
        self._expected: tuple[Transition, ExpectedMotion] | None = None  # the latest one, from that transition
        self._carried = False  # the state was begun before the current map
        self._unproven = False  # no motion of the images has agreed with it yet
        self._anew: Known | None = None  # the state begins again with this in the next frame

    @property
    def problem(self) -> str:
        """Why samples cannot be used; empty if they can."""
        return self._buffer.problem

    @property
    def is_trusted(self) -> bool:
        """Whether the samples have agreed with the images so far, so that they guide the search in the next images.

        Once they have agreed for long, a single contradicting frame shows a moving body.
        """
        agreement = self._agreement
        return not agreement.distrusted and (self._distance2 < self._rules.impossible or not agreement.is_young)

    def take(self, view: InertialView | None) -> None:
        """Add the samples that came with a frame, unless inertia is switched off; no sample is added twice."""
        if view is None or not self._config.enabled or view.samples is self._taken:
            return
        self._taken = view.samples
        if self._calibration is None:
            self._calibration = view.calibration
            self._buffer = SampleBuffer(view.calibration)
        self._buffer.add(view.samples)
        if not self._noise_known and (noise := self._buffer.noise()) is not None:
            of = view.calibration
            self._densities = Densities.begun(self._rules, noise / [of.gyro_noise, of.accel_noise])
            self._noise_known = True
        if self.problem and self.now is not None:
            logging.getLogger("stream_sfm").warning(self.problem)
            self.now = self._anew = None

    def begun(self, stamp_ns: int, world_from_cam: Array, cov_pose: Array) -> Known | None:
        """Return the initial state of a camera; None without samples around its stamp."""
        if self._calibration is None or self._buffer.problem:
            return None
        mean = self._buffer.mean_acceleration(stamp_ns)
        if mean is None:
            return None
        state, joint = np.zeros(STATE), np.zeros((JOINT.size, JOINT.size))
        state[GRAVITY] = -self._calibration.cam_from_imu[:3, :3] @ mean
        rules = self._rules
        wide = rules.std_velocity_m_s, rules.std_start_m_s2, rules.std_gyro_bias_rad_s, rules.std_accel_bias_m_s2
        std = np.repeat(wide, 3)
        joint[JOINT["pose"], JOINT["pose"]] = cov_pose
        joint[JOINT["state"], JOINT["state"]] = np.diag(np.r_[std, self._std_fixed] ** 2)
        return Known(stamp_ns, world_from_cam, state, joint)

    def begin(self, current: Map, stamp_ns: int, world_from_cam: Array, cov_pose: Array) -> None:
        """Give a new map its inertial state: the predicted one, or else an initial one."""
        known = self.predicted(stamp_ns)
        self._carried = self._unproven = known is not None and not self._agreement.is_young
        if known is None:
            known = self.begun(stamp_ns, world_from_cam, cov_pose)
        if known is None or self._calibration is None:
            return
        knows = bool(np.trace(known.cov_state[GRAVITY, GRAVITY]) < self._rules.known_gravity_m2_s4)
        window = InertialWindow(self._calibration.cam_from_imu, self._densities.factors, self._rules, knows)
        current.begin_inertia(window, known)
        self.now = known

    def forget(self) -> None:
        """Forget the state: if the motion may have been a body's, its velocity predicts nothing."""
        self.now = self._anew = None

    def predicted(self, stamp_ns: int) -> Known | None:
        """Return pose and state at a later time, by the samples alone, eq. (81); None if samples are missing."""
        if self.now is not None and stamp_ns == self.now.stamp_ns and not self.problem:
            return self.now
        found = self.transition(stamp_ns)
        return None if found is None or self.now is None else self.now.carried(found, stamp_ns)

    def transition(self, stamp_ns: int) -> Transition | None:
        """Return the transition from the latest state to a later time; None if samples are missing."""
        now, calibration = self.now, self._calibration
        if now is None or calibration is None or self._buffer.problem:
            return None
        ahead_ns = stamp_ns - now.stamp_ns
        if not 0 < ahead_ns <= self._rules.max_gap_s * 1e9 or not self._buffer.covers(now.stamp_ns, stamp_ns):
            return None
        return self._leading(now.stamp_ns, stamp_ns, now, calibration.cam_from_imu)

    def _leading(self, first_ns: int, last_ns: int, now: Known, cam_from_imu: Array) -> Transition:
        """Return the cached transition from a state over an interval, which each frame needs several times."""
        of = now, first_ns, last_ns, self._buffer.last_ns, self._densities, self._jitter
        if self._led is None or self._led[0] != of:
            interval = self._interval(first_ns, last_ns, now.state)
            self._led = of, transition(now.state, interval, self._densities.factors, cam_from_imu)
        return self._led[1]

    def prediction(self, stamp_ns: int, view: InertialView | None) -> Prediction | None:
        """Return pose and state at a later time with further samples, which are not kept; None if some are missing."""
        ahead = copy(self)
        ahead._buffer = self._buffer.copied()
        ahead.take(view)
        known = ahead.predicted(stamp_ns)
        if known is None:
            return None
        inertial = inertial_estimate(known, self._densities.factors)
        return Prediction(stamp_ns, known.world_from_cam, known.cov_pose, inertial)

    def _interval(self, first_ns: int, last_ns: int, state: Array) -> Interval:
        calibration = self._calibration
        if calibration is None or not self._buffer.covers(first_ns, last_ns):
            return Interval.unknown((last_ns - first_ns) / 1e9, state)
        samples = self._buffer.between(first_ns, last_ns, float(state[CLOCK][0]))
        return Interval.of(samples, calibration, state, self._densities.factors, self._jitter.var_interval)

    def enter(self, frame: WindowFrame, current: Map) -> None:
        """Give a frame that is about to enter a map the samples since the previous frame."""
        self._begin_late(current)
        window, now = current.inertia, self.now
        if window is not None and now is None:
            current.end_inertia()
        if window is None or now is None:
            return
        window.factors = self._densities.factors
        before = (current.frames[-1] if current.frames else current.reference).stamp_ns
        if current.frames and not window.intervals[-1].complete:  # its samples have arrived by now
            first = (current.frames[-2] if len(current.frames) > 1 else current.reference).stamp_ns
            window.intervals[-1] = self._interval(first, before, now.state)
        found = self._leading(before, frame.stamp_ns, now, window.cam_from_imu)
        frame.interval = found.interval
        frame.velocity = (found if frame.interval.cov_gyro.any() else now).state[VELOCITY]
        self._note = frame.interval.note
        frame.turning = self._turning(frame.stamp_ns, now.state) if self.is_trusted else None
        if current.first_views is not None and self.is_trusted:  # later frames show their motion better
            current.reference.turning = self._turning(current.reference.stamp_ns, now.state)

    def _turning(self, stamp_ns: int, state: Array) -> Array | None:
        """Return angular velocity and acceleration (2, 3) of points in the camera at a time, from the gyroscope."""
        found = self._buffer.turning(stamp_ns, float(state[CLOCK][0]))
        if found is None or self._calibration is None:
            return None
        mounted = self._calibration.cam_from_imu[:3, :3] @ se3.exp_so3(state[AXES])
        return -np.stack([found[0] - state[GYRO_BIAS], found[1]]) @ mounted.T

    def _begin_late(self, current: Map) -> None:
        """Begin the state of a map in its newest camera, after a contradiction or if samples started late."""
        begun, self._anew, calibration = self._anew, None, self._calibration
        if current.inertia is None and not self.problem:
            newest = (current.frames[-1] if current.frames else current.reference).stamp_ns
            begun = self.begun(newest, current.marginals.world_from_cam, current.marginals.cov_pose)
        if begun is not None and calibration is not None:
            window = InertialWindow(
                calibration.cam_from_imu, self._densities.factors, self._rules, knows_gravity=False
            )
            current.begin_inertia(window, begun)
            self.now = begun

    def judge(self, motion: Resection, frame: WindowFrame) -> Resection:
        """Compare the motions from images and samples, eq. (85); if they disagree, either may be the camera's.

        Raises NotTheCameraError if the map is new and the samples are not.
        """
        now = self.now
        if frame.interval is None or now is None:
            return motion
        expected = self.expected_motion(frame.stamp_ns)
        if expected is None or not frame.interval.cov_gyro.any():
            return motion
        cov = self._rules.farther**2 * (motion.spread * motion.cov_pose)
        distance2, late_s, var_s2 = distance2_of(expected, motion.cam_from_ref, cov, frame.std_turn_rad)
        self._jitter = self._jitter.after(late_s, max(var_s2 - frame.interval.var_time, 0.0))
        more_s2 = self._jitter.var_interval - frame.interval.var_time
        if more_s2 > 0:  # than the prediction was made with
            frame.interval = changed(frame.interval, var_time=self._jitter.var_interval)
            distance2 -= more_s2 / (var_s2 + more_s2) * late_s**2 / var_s2
        turns = (
            float(np.linalg.norm(se3.log_so3(frame.interval.rotation))),
            float(np.linalg.norm(se3.log_so3(motion.cam_from_ref[:3, :3]))),
        )
        self._unproven = self._unproven and distance2 > self._rules.impossible
        if self._unproven and self.dead_reckoned(frame.stamp_ns) is not None:
            raise NotTheCameraError("the images of a new map contradict the samples: they may show a moving body")
        self._distance2 = distance2
        self._agreement = self._agreement.after(distance2, frame.interval.seconds, turns)
        # this interval may be wrong, even if the others agree
        if self._agreement.contradicts or distance2 > self._rules.impossible:
            frame.interval = frame.interval.open()
        if not (self._agreement.contradicts or (self._agreement.distrusted and self._agreement.is_young)):
            return motion
        other = SecondMotion(
            se3.inverse(expected.previous_from_cam), expected.cov, np.zeros_like(motion.accepted), odds=1.0
        )
        return replace(motion, second=other)

    def expected_motion(self, stamp_ns: int) -> ExpectedMotion | None:
        """Return the motion from the latest estimate to a stamp, predicted by the samples."""
        now, calibration, found = self.now, self._calibration, self.transition(stamp_ns)
        if now is None or calibration is None or found is None:
            return None
        if self._expected is not None and self._expected[0] is found:  # each frame needs it twice
            return self._expected[1]
        cov = now.cov.copy()
        cov[JOINT["pose"]], cov[:, JOINT["pose"]] = 0.0, 0.0
        then = Known(now.stamp_ns, np.eye(4), now.state, cov).carried(found, stamp_ns)
        rate = self._buffer.rate(stamp_ns, float(then.state[CLOCK][0])) - then.state[GYRO_BIAS]
        mounted = calibration.cam_from_imu[:3, :3] @ se3.exp_so3(then.state[AXES])
        twist = -np.concatenate([then.state[VELOCITY], mounted @ rate])
        flags = {"carried": self._carried, "agreed": not self._agreement.is_young}
        expected = ExpectedMotion(now.stamp_ns, then.world_from_cam, then.cov_pose, twist, **flags)
        self._expected = found, expected
        return expected

    def dead_reckoned(self, stamp_ns: int) -> InertialEstimate | None:
        """Return the state at a time without a pose from images; None if its σ is too large to report it."""
        known = self.predicted(stamp_ns)
        if known is None:
            return None
        std_m, std_rad = (float(np.sqrt(np.linalg.eigvalsh(known.cov[k : k + 3, k : k + 3])[-1])) for k in (0, 3))
        if not (std_m <= self._config.max_std_m and std_rad <= self._rules.max_std_turn_rad):
            return None
        return replace(inertial_estimate(known, self._densities.factors), dead_reckoned=True)

    def report(self, current: Map, read_off: Map) -> tuple[Known | None, InertialEstimate | None]:
        """Return the newest pose and state, with zero for improbable errors; None without inertia.

        The mean is that of the map `read_off`, from which estimates are reported; the covariance is that of the filter,
        `current`.
        """
        window = current.inertia
        if window is None:
            self.now = None
            return None, None
        stamp_ns = (current.frames[-1] if current.frames else current.reference).stamp_ns
        seen = current.cams_from_ref, current.inertial_state
        known, by_rig = window.newest(current.system, stamp_ns, current.world_from_ref, *seen)
        cov = symmetric(known.cov + by_rig @ current.system.cov_rig @ by_rig.T)
        if read_off.inertia is not None and read_off is not current:
            of_mean = read_off.world_from_ref, read_off.cams_from_ref, read_off.inertial_state
            pose, state = read_off.inertia.newest_mean(*of_mean)
            known = changed(known, world_from_cam=pose, state=state)
        if len(current.frames) == self._frames:
            window.learn(current.system, *seen)
            self._densities = self._densities.after(window.surprise)
        known = self._with_odds(known, cov)
        doubted = known.cov.copy()
        doubted[JOINT["pose"], JOINT["pose"]] += current.cov_doubt
        self.now = changed(known, cov=doubted)  # predictions begin there
        is_wrong = impossible(known.state, known.cov_state, self._rules)
        if is_wrong or (
            self._agreement.contradicts and self._agreement.is_young
        ):  # forget a state from a wrong motion
            self._agreement = self._agreement.anew()
            self._anew = self.begun(stamp_ns, known.world_from_cam, known.cov_pose)
        note = "; ".join(filter(None, [self._agreement.note, self._note]))
        return known, inertial_estimate(self.now, self._densities.factors, self._distance2, note)

    def placed(self, estimate: InertialEstimate | None, world_from_cam: Array) -> InertialEstimate | None:
        """Move the latest pose to the reported one; the move is a known error, and is added to its covariance."""
        if self.now is None or estimate is None:
            return estimate
        by = se3.log(se3.inverse(world_from_cam) @ self.now.world_from_cam)
        cov = self.now.cov.copy()
        cov[JOINT["pose"], JOINT["pose"]] += np.outer(by, by)
        self.now = Known(self.now.stamp_ns, world_from_cam, self.now.state, cov)
        return replace(estimate, cov=cov)

    def _with_odds(self, known: Known, cov: Array) -> Known:
        """Return pose and state at the probable scale, axes and clock, eq. (87).

        `known` is conditional on the rig's errors, which are held; `cov` (23, 23) is not. While these are held, the
        effect on the pose that scale and rig have in common is attributed to the rig, so the pose moves by the
        conditional covariances.
        """
        apart = likely(known.state, cov[JOINT["state"], JOINT["state"]], self._std_fixed, self._rig)
        apart -= known.state[FIXED]
        at = JOINT.within("state", FIXED)
        moved = known.cov[:, at] @ np.linalg.solve(known.cov[at, at], apart)
        state = known.state + moved[JOINT["state"]]
        pose = se3.orthonormalise(known.world_from_cam @ se3.exp(moved[JOINT["pose"]]))
        cov = symmetric(cov + np.outer(moved, moved))  # the squared moves of the fixed parameters are added
        return Known(known.stamp_ns, pose, state, cov)


def inertial_estimate(known: Known, factors: Array, distance2: float = 0.0, note: str = "") -> InertialEstimate:
    """Return the reported form of a state."""
    s = known.state
    return InertialEstimate(
        *(s[VELOCITY], s[GRAVITY], s[GYRO_BIAS], s[ACCEL_BIAS], float(s[SCALE][0]), s[AXES], float(s[CLOCK][0])),
        *(known.cov, factors[:2], distance2),
        note=note,
    )


class TakesSamples:
    """The methods of every estimator that uses inertial samples; see `InertialEstimator`."""

    inertia: Inertia

    @property
    def inertial_problem(self) -> str:
        """Why inertial samples are not used."""
        return self.inertia.problem

    def expect(self, stamp_ns: int, view: InertialView | None) -> ExpectedMotion | None:
        """Return the motion that inertial samples predict for the next frame."""
        self.inertia.take(view)
        return self.inertia.expected_motion(stamp_ns) if self.inertia.is_trusted else None

    def predict(self, stamp_ns: int, view: InertialView | None) -> Prediction | None:
        """Return pose and state at a later time, predicted by inertial samples."""
        return self.inertia.prediction(stamp_ns, view)

    def by_inertia_if_lost(self, solution: Solution, stamp_ns: int) -> Solution:
        """Return the solution of a frame; if it is lost, dead-reckoned by inertia as long as σ is small enough."""
        if solution.status != Status.LOST or solution.inertial is not None:
            return solution
        by_inertia = self.inertia.dead_reckoned(stamp_ns)
        if by_inertia is None:
            return solution
        reason = f"dead-reckoned by the IMU: {solution.reason}"
        return replace(solution, status=Status.DEGRADED, reason=reason, inertial=by_inertia)


class InertialMotionModel(MotionModel):
    """The motion model with inertial samples, which predict if they reach the requested time."""

    def __init__(self, config: Config, inertia: Inertia) -> None:
        super().__init__(config.motion)
        self._inertia = inertia

    def predict(self, stamp_ns: int) -> tuple[Array, Array]:
        """Predict pose (4, 4) and covariance (6, 6) by samples, eq. (81), or else as `MotionModel` does."""
        known = self._inertia.predicted(stamp_ns) if self.started else None
        if known is None:
            return super().predict(stamp_ns)
        return known.world_from_cam, known.cov_pose.copy()
