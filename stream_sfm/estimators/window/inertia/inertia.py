"""Inertia in the window estimator: samples to intervals, predictions between frames, and the reported state.

No initialisation is needed: velocity, gravity and biases begin with a large σ in the first frame that has samples, and
the samples are linear in them. The map estimates them together with its world (`inertial_window.py`).
"""

import logging
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from ....config import Config
from ....geometry import Array, se3
from ....geometry.linear import symmetric
from ....geometry.resection import Resection, SecondMotion
from ....inertial.buffer import SampleBuffer
from ....inertial.samples import ImuCalibration, ImuSamples
from ....inertial.state import AXES, CLOCK, GRAVITY, GYRO_BIAS, STATE, VELOCITY
from ....record import changed
from ....types import ExpectedMotion, InertialEstimate, InertialView, Prediction
from ...lifecycle import LostError
from ..absorb import with_inertia, without_inertia
from ..state import WindowState
from ..window_frame import WindowFrame
from .belief import Belief, Innovation, Steadiness
from .checks import Densities, Jitter, Surprise, impossible, inertial_estimate, with_odds
from .inertial_window import InertialWindow
from .interval import JOINT, Interval, Known, Transition, transition
from .rules import InertiaRules
from .trial import beside, corrected

_BY_IMAGES = "poses are by images alone until samples agree with them for a while"
_LEAST_STD_SCALE = 1e-6  # keeps its variance above rounding


class NotTheCameraError(LostError):
    """The images of a new map contradict the samples, so they show a moving body."""


class Inertia:
    """The inertial knowledge of an estimator between frames; `now`: at the latest estimate, None before the first."""

    def __init__(self, config: Config) -> None:
        self._config, self._rig, self._rules = config.imu, config.rig, config.rules.of(InertiaRules)
        scale = _LEAST_STD_SCALE if config.rig.exact else max(config.rig.std_baseline, _LEAST_STD_SCALE)
        self._std_fixed = np.r_[scale, np.full(3, self._config.std_axes_rad), self._config.std_time_offset_s]
        self._calibration: ImuCalibration | None = None
        self._buffer = SampleBuffer(ImuCalibration())
        self._taken: ImuSamples | None = None  # the latest ones
        self.now: Known | None = None
        self._belief = Belief.begun(self._rules, np.array(config.motion.std_acceleration))
        self._steadiness, self._densities = Steadiness(self._rules), Densities.begun(self._rules)
        self._jitter, self._surprise = Jitter(self._rules), Surprise(self._rules)
        self._noise_known = False  # from the samples themselves
        self._distance2, self._note, self._frames = 0.0, "", config.window.frames
        self._led: tuple[tuple[Any, ...], Transition] | None = None  # the latest one, and its arguments
        self._expected_by: tuple[Transition, ExpectedMotion] | None = None  # the latest one, from that transition
        self._unproven = False  # no motion of the images has agreed with it yet
        self._restart: Known | None = None  # the state begins again with this in the next frame
        self._is_fresh = True  # the velocity is not known yet, so that nothing can be expected of the samples
        self._missing_s = 0.0  # the time without samples
        self._before_ns = 0  # the stamp of the frame before the latest one
        self._trial: Known | None = None  # the state at the latest frame while samples are not used
        self.contradiction = ""  # of samples and images, in the latest frame
        self.problem = ""  # why samples are not used, or were not; empty if there was no reason

    @property
    def is_trusted(self) -> bool:
        """Whether the samples have agreed with the images so far, so that they guide the search in the next images.

        Once they have agreed for long, a single contradicting frame shows a moving body.
        """
        belief = self._belief
        return not (belief.is_out or belief.contradicted) and (self._distance2 < self._rules.apart or belief.is_proven)

    def take(self, view: InertialView | None, stamp_ns: int) -> None:
        """Add the samples that came with a frame, unless inertia is switched off; no sample is added twice."""
        if view is None or not self._config.enabled or view.samples is self._taken:
            return
        self._taken = view.samples
        if self._calibration is None:
            self._calibration = view.calibration
            self._buffer = SampleBuffer(view.calibration)
        self._buffer.add(view.samples, stamp_ns)
        if not self._noise_known and (noise := self._buffer.noise()) is not None:
            of = view.calibration
            self._densities = Densities.begun(self._rules, noise / [of.gyro_noise, of.accel_noise])
            self._noise_known = True
        if self._buffer.problem and (self.now is not None or self.problem != self._buffer.problem):
            self._end(self._buffer.problem)

    def _end(self, problem: str) -> None:
        """Continue without samples."""
        logging.getLogger("stream_sfm").warning(problem)
        self.problem, self.now, self._restart, self._trial = problem, None, None, None
        self._steadiness, self._surprise = Steadiness(self._rules), Surprise(self._rules)

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
        joint[JOINT["pose"], JOINT["pose"]] = cov_pose
        joint[JOINT["state"], JOINT["state"]] = np.diag(np.r_[np.repeat(wide, 3), self._std_fixed] ** 2)
        return Known(stamp_ns, world_from_cam, state, joint)

    def begin(self, current: WindowState, stamp_ns: int, world_from_cam: Array, cov_pose: Array) -> WindowState:
        """Give a new map its inertial state: the predicted one, or else an initial one."""
        known = None if self._belief.is_out else self.predicted(stamp_ns)
        self._unproven = known is not None and (self._belief.is_proven or self._unproven)
        self._belief, self._trial = self._belief.interrupted(), None
        if self._belief.is_out:
            self.now = None
            return current
        if known is None:
            self._is_fresh = True
            known = self.begun(stamp_ns, world_from_cam, cov_pose)
        if known is None or self._calibration is None:
            return current
        knows = bool(np.trace(known.cov_state[GRAVITY, GRAVITY]) < self._rules.known_gravity_m2_s4)
        window = InertialWindow(self._calibration.cam_from_imu, self._densities.factors, self._rules, knows)
        self.now = known
        return with_inertia(current, window, known)

    def forget(self) -> None:
        """Forget the state: if the motion may have been a body's, its velocity predicts nothing."""
        self.now = self._restart = None
        self._belief = self._belief.interrupted()

    def predicted(self, stamp_ns: int) -> Known | None:
        """Return pose and state at a later time, by the samples alone, eq. (81); None if samples are missing."""
        if self.now is not None and stamp_ns == self.now.stamp_ns:
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
        ahead.take(view, stamp_ns)
        known = ahead.predicted(stamp_ns)
        if known is None:
            return None
        return Prediction(stamp_ns, known.world_from_cam, known.cov_pose, self.estimated(known))

    def _interval(self, first_ns: int, last_ns: int, state: Array) -> Interval:
        calibration = self._calibration
        if calibration is None or not self._buffer.covers(first_ns, last_ns):
            return Interval.unknown((last_ns - first_ns) / 1e9, state)
        samples = self._buffer.between(first_ns, last_ns, float(state[CLOCK][0]))
        return Interval.of(samples, calibration, state, self._densities.factors, self._jitter.var_interval)

    def enter(self, current: WindowState, frame: WindowFrame) -> tuple[WindowState, WindowFrame]:
        """Give a frame that is about to enter a map the samples since the previous frame."""
        before = self._before_ns = current.newest_frame.stamp_ns
        current = self._begun_in_newest(current)
        window, now, self.contradiction = current.inertia, self.now, ""
        if window is not None and now is None:
            current = without_inertia(current)
        if window is None or now is None:
            return current, frame
        window = changed(window, factors=self._densities.factors)
        if current.frames and window.intervals[-1].lacks_end:  # its last samples have arrived by now
            last = self._interval(current.all_frames[-2].stamp_ns, before, now.state)
            window = changed(window, intervals=(*window.intervals[:-1], last))
        current = changed(current, inertia=window)
        found = self._leading(before, frame.stamp_ns, now, window.cam_from_imu)
        dense = found.interval.dense
        self._missing_s = 0.0 if dense else self._missing_s + found.interval.seconds
        if self._missing_s >= self._rules.lasting_s:
            self._belief = self._belief.interrupted().on_trial()
            self._end(f"inertial samples have been missing for {self._missing_s:.1f} s: {_BY_IMAGES}")
            return without_inertia(current), frame
        self._note = found.interval.note
        guides = self.guiding(frame.stamp_ns) is not None
        if current.first_views is not None and guides:  # later frames show their motion better
            turning = self._turning(current.reference.stamp_ns, now.state)
            current = changed(current, reference=changed(current.reference, turning=turning))
        return current, changed(
            frame,
            interval=found.interval,
            velocity=(found if dense else now).state[VELOCITY],
            turning=self._turning(frame.stamp_ns, now.state) if guides else None,
        )

    def _turning(self, stamp_ns: int, state: Array) -> Array | None:
        """Return angular velocity and acceleration (2, 3) of points in the camera at a time, from the gyroscope."""
        found = self._buffer.turning(stamp_ns, float(state[CLOCK][0]))
        if found is None or self._calibration is None:
            return None
        mounted = self._calibration.cam_from_imu[:3, :3] @ se3.exp_so3(state[AXES])
        return -np.stack([found[0] - state[GYRO_BIAS], found[1]]) @ mounted.T

    def _begun_in_newest(self, current: WindowState) -> WindowState:
        """Begin the state of a map in its newest camera: again, if samples started late, or after a trial."""
        begun, self._restart, calibration = self._restart, None, self._calibration
        if current.inertia is None and not self._belief.is_out:
            pose = current.marginals.world_from_cam, current.marginals.cov_pose
            begun = self.begun(self._before_ns, *pose)
            if begun is not None and (tried := self._trial) is not None and tried.stamp_ns == self._before_ns:
                begun = beside(self._before_ns, *pose, tried.state, tried.cov_state)
            self._trial = None
        if begun is None or calibration is None:
            return current
        window = InertialWindow(calibration.cam_from_imu, self._densities.factors, self._rules, knows_gravity=False)
        self.now, self._is_fresh = begun, True
        return with_inertia(current, window, begun)

    def judge(self, motion: Resection, frame: WindowFrame) -> tuple[Resection, WindowFrame]:
        """Compare the motions from images and samples; if they contradict, either may be the camera's.

        The frame's interval then has nearly no information. Raises NotTheCameraError if only the map is new.
        """
        if frame.interval is None or self.now is None:
            self._try(motion, frame)
            return motion, frame
        expected, rules = self.expected_motion(frame.stamp_ns), self._rules
        if expected is None or not frame.interval.dense:
            self._belief = self._belief.interrupted()
            return motion, frame
        found = self._innovation(expected, motion, frame)
        if motion.ambiguous is not None and not self._belief.is_proven:  # neither can confirm the other
            self._belief, self._is_fresh = self._belief.interrupted(), True
            return motion, changed(frame, interval=frame.interval.open(found.weighed.distance2))
        distance2, interval = self._learn_jitter(found, frame.interval)
        self._unproven = self._unproven and distance2 > rules.apart
        if motion.ambiguous is None:
            self._belief = self._belief.after(found, self._is_fresh)
        self._is_fresh, self._distance2 = distance2 > rules.apart, distance2
        if self._unproven and not self._belief.is_out and self.dead_reckoned(frame.stamp_ns) is not None:
            raise NotTheCameraError("the images of a new map contradict the samples: they may show a moving body")
        self._surprise = self._surprise.after(distance2)
        if distance2 <= rules.apart:
            return motion, changed(frame, interval=interval.wider(self._surprise.factor))
        frame = changed(frame, interval=interval.open(distance2))  # it may be wrong, even if the others agree
        if not (self._belief.contradicted and self._belief.lasted_s):  # a single frame is no contradiction
            return motion, frame
        self.contradiction = self._belief.problem
        other = SecondMotion(
            se3.inverse(expected.previous_from_cam), expected.cov, np.zeros_like(motion.accepted), odds=1.0
        )
        return replace(motion, second=other), frame

    def _innovation(self, expected: ExpectedMotion, motion: Resection, frame: WindowFrame) -> Innovation:
        cov = self._rules.farther**2 * (motion.spread * motion.cov_pose)
        seconds = (frame.stamp_ns - expected.since_ns) / 1e9
        return Innovation.of(expected, motion.cam_from_ref, cov, frame.std_turn_rad, seconds)

    def _learn_jitter(self, found: Innovation, interval: Interval) -> tuple[float, Interval]:
        """Learn the errors of stamps, and return the squared distance of the motions, and the interval, with them."""
        distance2, _, late_s, var_s2 = found.weighed
        self._jitter = self._jitter.after(late_s, max(var_s2 - interval.var_time, 0.0))
        more_s2 = self._jitter.var_interval - interval.var_time
        if more_s2 <= 0:
            return distance2, interval
        interval = changed(interval, var_time=self._jitter.var_interval)  # more than it was predicted with
        return distance2 - more_s2 / (var_s2 + more_s2) * late_s**2 / var_s2, interval

    def _try(self, motion: Resection, frame: WindowFrame) -> None:
        """Carry on the trial of samples that are not used; each of its states begins and ends as one of a map does."""
        tried, calibration, before = self._trial, self._calibration, self._before_ns
        self._trial = None
        if calibration is None or self._buffer.problem or motion.ambiguous is not None:
            self._belief = self._belief.interrupted()
            return
        if is_fresh := tried is None or tried.stamp_ns != before:
            self._belief = self._belief.on_trial()
            tried = self.begun(before, np.eye(4), np.zeros((6, 6)))
        interval = None if tried is None else self._interval(before, frame.stamp_ns, tried.state)
        if tried is None or interval is None or not interval.dense:
            self._belief = self._belief.interrupted()
            return
        by = transition(tried.state, interval, self._densities.factors, calibration.cam_from_imu)
        then = tried.carried(by, frame.stamp_ns)
        found = self._innovation(self._expected(tried, then), motion, frame)
        self._belief = self._belief.after(found, is_fresh)
        if found.weighed.distance2 < self._rules.apart:
            tried = corrected(then, found)
            self._trial = None if impossible(tried.state, tried.cov_state, self._rules) else tried

    def expected_motion(self, stamp_ns: int) -> ExpectedMotion | None:
        """Return the motion from the latest estimate to a stamp, predicted by the samples."""
        now, found = self.now, self.transition(stamp_ns)
        if now is None or found is None:
            return None
        if self._expected_by is None or self._expected_by[0] is not found:  # each frame needs it twice
            cov = now.cov.copy()
            cov[JOINT["pose"]], cov[:, JOINT["pose"]] = 0.0, 0.0
            since = Known(now.stamp_ns, np.eye(4), now.state, cov)
            self._expected_by = found, self._expected(since, since.carried(found, stamp_ns))
        return self._expected_by[1]

    def _expected(self, since: Known, then: Known) -> ExpectedMotion:
        """Return the motion from one pose, which is the origin, to another."""
        mounted = np.eye(3) if self._calibration is None else self._calibration.cam_from_imu[:3, :3]
        rate = self._buffer.rate(then.stamp_ns, float(then.state[CLOCK][0])) - then.state[GYRO_BIAS]
        twist = -np.concatenate([then.state[VELOCITY], mounted @ se3.exp_so3(then.state[AXES]) @ rate])
        motion = since.stamp_ns, then.world_from_cam, then.cov_pose, twist
        return ExpectedMotion(*motion, agreed=self._belief.is_proven)

    def guiding(self, stamp_ns: int) -> ExpectedMotion | None:
        """Return the expected motion if the samples are trusted, none is missing, and a camera can move so."""
        found = self.transition(stamp_ns) if self.is_trusted else None
        if found is None or not found.interval.dense:
            return None
        motion = se3.log(found.previous_from_now), found.interval.seconds
        possible = self._belief.evenly.allows(*motion, self._rules.most_change)
        return self.expected_motion(stamp_ns) if possible else None

    def dead_reckoned(self, stamp_ns: int) -> InertialEstimate | None:
        """Return the state at a time without a pose from images; None if its σ is too large to report it."""
        known = self.predicted(stamp_ns)
        if known is None:
            return None
        std_m, std_rad = (float(np.sqrt(np.linalg.eigvalsh(known.cov[k : k + 3, k : k + 3])[-1])) for k in (0, 3))
        if not (std_m <= self._config.max_std_m and std_rad <= self._rules.max_std_turn_rad):
            return None
        return replace(self.estimated(known), dead_reckoned=True)

    def report(self, current: WindowState, smoothed: WindowState) -> tuple[Known | None, InertialEstimate | None]:
        """Return the newest pose and state, with zero for improbable errors; None without inertia.

        The mean is that of the map `smoothed`, from which estimates are reported; the covariance is that of the filter,
        `current`.
        """
        window = current.inertia
        if window is None:
            self.now = None
            return None, None
        stamp_ns = current.newest_frame.stamp_ns
        seen = current.cams_from_ref, current.inertial_state
        known, by_rig = window.newest(current.system, stamp_ns, current.world_from_ref, *seen)
        cov = symmetric(known.cov + by_rig @ current.system.cov_rig @ by_rig.T)
        if smoothed.inertia is not None and smoothed is not current:
            of_mean = smoothed.world_from_ref, smoothed.cams_from_ref, smoothed.inertial_state
            pose, state = smoothed.inertia.newest_mean(*of_mean)
            known = changed(known, world_from_cam=pose, state=state)
        if len(current.frames) == self._frames and not current.frames[0].is_ambiguous:
            self._densities = self._densities.after(window.surprise(current.system, *seen))
        known = with_odds(known, cov, self._std_fixed, self._rig)
        cov = known.cov.copy()
        cov[JOINT["pose"], JOINT["pose"]] += current.cov_ambiguous
        self.now = changed(known, cov=cov)  # predictions begin there
        self._steadiness, moved = self._steadiness.after(known)
        moved = moved and self._belief.is_proven  # its noise is not known before
        if moved or impossible(known.state, known.cov_state, self._rules):  # forget a state from a wrong motion
            self._belief, self._steadiness = self._belief.restarted(), Steadiness(self._rules)
            self._restart = self.begun(stamp_ns, known.world_from_cam, known.cov_pose)
        note = "; ".join(filter(None, [self.contradiction, self._note]))
        estimate = replace(self.estimated(self.now), distance2=self._distance2, note=note)
        if self._belief.is_out:
            self._end(f"{self._belief.problem}: {_BY_IMAGES}")
        return known, estimate

    def estimated(self, known: Known) -> InertialEstimate:
        """Return the reported form of a state: down may be anywhere while the samples are not proven."""
        is_known = self._belief.is_proven and self._densities.explain_residuals
        return inertial_estimate(known, self._densities.factors, 0.0 if is_known else self._rules.std_any_tilt_rad)

    def placed(self, estimate: InertialEstimate | None, world_from_cam: Array) -> InertialEstimate | None:
        """Move the latest pose to the reported one; the move is a known error, and is added to its covariance."""
        if self.now is None or estimate is None:
            return estimate
        by, moved = se3.log(se3.inverse(world_from_cam) @ self.now.world_from_cam), np.zeros_like(estimate.cov)
        moved[JOINT["pose"], JOINT["pose"]] = np.outer(by, by)
        self.now = Known(self.now.stamp_ns, world_from_cam, self.now.state, self.now.cov + moved)
        return replace(estimate, cov=estimate.cov + moved)
