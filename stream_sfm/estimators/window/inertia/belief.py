"""Whether samples are believed: how well they predict the motions that images show, summed over frames, eq. (85a).

They are compared with the motion before: a unit that predicts worse than a constant velocity is of no use, whatever is
wrong with it. Rotations and translations are judged apart, as gyroscope and accelerometer fail apart.
"""

from dataclasses import field
from functools import cached_property

import numpy as np

from .... import core
from ....geometry import Array
from ....geometry.linear import mahalanobis2
from ....inertial.state import GRAVITY
from ....record import changed, record
from ....types import ExpectedMotion
from .interval import Known
from .rules import InertiaRules

_DEGREES = 180 / np.pi
_PARTS = slice(3, 6), slice(0, 3)  # of a motion: rotation, by the gyroscope, and translation, by the accelerometer
_LEAST_TURN_RAD = 1e-3  # with less, a ratio of rotations is noise


@record
class Innovation:
    """A motion by images, compared with the expected one, eq. (85): their difference (6,) and its covariance (6, 6).

    `seconds`: the time between the frames; `motion` (6,): by images, of the camera; `turned_rad`: as expected; `twist`
    (6,): per second, of points in the camera.
    """

    apart: Array
    cov: Array
    seconds: float
    motion: Array
    turned_rad: float
    twist: Array = field(default_factory=lambda: np.zeros(6))

    @classmethod
    def of(
        cls, expected: ExpectedMotion, cam_from_previous: Array, cov: Array, std_slide_rad: float, seconds: float
    ) -> "Innovation":
        """Compare a motion (4, 4); `cov` (6, 6): of the inverse motion; `std_slide_rad`: of patches that slide."""
        apart, both, motion, turned_rad = core.innovation(
            expected.previous_from_cam, expected.cov, cam_from_previous, cov, std_slide_rad
        )
        return cls(apart, both, seconds, motion, turned_rad, expected.twist)

    @cached_property
    def weighed(self) -> core.WeighedInnovation:
        """The squared distance of the motions, log-likelihoods, and the time that the difference takes."""
        return core.weigh_innovation(self.apart, self.cov, self.twist)


@record
class Evenly:
    """What images alone predict: that the camera keeps its `velocity` (6,) per second; None if it is not known.

    `squares` (2,): the mean squared change of angular and linear velocity between frames, per axis, and those `assumed`
    at first; `count`: frames that they were learnt from.
    """

    frames: float
    assumed: Array
    squares: Array
    count: int = 0
    velocity: Array | None = None

    def after(self, motion: Array, seconds: float) -> "Evenly":
        """Return the prediction after a motion (6,)."""
        velocity, squares, count = motion / seconds, self.squares, self.count
        if self.velocity is not None:
            changes = np.array([np.square((velocity - self.velocity)[at]).mean() for at in _PARTS])
            count = count + 1
            squares = squares + (changes - squares) / min(count + 1, self.frames)
        return changed(self, velocity=velocity, squares=squares, count=count)

    def allows(self, motion: Array, seconds: float, most: float) -> bool:
        """Whether a motion (6,) does not change the velocity by more than `most` times its usual change."""
        if self.velocity is None:
            return True
        changes = np.array([np.linalg.norm((motion / seconds - self.velocity)[at]) for at in _PARTS])
        return bool((changes <= most * np.sqrt(np.maximum(self.squares, self.assumed))).all())

    def log_likelihoods(self, motion: Array, seconds: float) -> Array | None:
        """Return the log-likelihoods (2,) of rotation and translation of the next motion, without the constant."""
        if self.velocity is None:
            return None
        squares = self.squares * seconds**2
        apart = motion - self.velocity * seconds
        sums = np.array([np.square(apart[at]).sum() for at in _PARTS])
        return np.asarray(-0.5 * (sums / squares + 3 * np.log(squares)))


@record
class Belief:
    """Whether samples describe the motion of the camera.

    `log_odds` (2,): by rotations and by translations; each is bounded, so that the latest frames decide. `lasted_s`:
    the time since one of them became negative, or since none is. `is_out`: contradictions have lasted, so that samples
    are not used until they agree for as long. `restarts`: how often the state was impossible since it last was proven.
    `log_ratio`: smoothed logarithm of the ratio of rotations by gyroscope and by images.
    """

    rules: InertiaRules
    evenly: Evenly
    log_odds: tuple[float, float] = (0.0, 0.0)
    lasted_s: float = 0.0
    is_out: bool = False
    restarts: int = 0
    log_ratio: float = 0.0

    @classmethod
    def begun(cls, rules: InertiaRules, std_acceleration: Array, seconds: float = 0.1) -> "Belief":
        """Return the belief before any frame; `std_acceleration` (6,): of a vehicle, assumed until motions show it."""
        squares = np.array([np.square(std_acceleration[at] * seconds).mean() for at in _PARTS])
        return cls(rules, Evenly(rules.usual_frames, squares, squares))

    @property
    def contradicted(self) -> bool:
        """Whether the latest frames speak against the samples."""
        return min(self.log_odds) < 0

    @property
    def is_proven(self) -> bool:
        """Whether the samples have agreed for so long that a frame that contradicts them may show a moving body."""
        return not self.contradicted and not self.is_out and self.lasted_s >= self.rules.lasting_s

    def after(self, found: Innovation, is_fresh: bool = False) -> "Belief":
        """Return the belief after a frame.

        `is_fresh`: nothing was to be expected of the samples yet, so that only a contradiction counts.
        """
        rules, by_images = self.rules, self.evenly.log_likelihoods(found.motion, found.seconds)
        contradicts = found.weighed.distance2 > rules.apart
        if is_fresh and not contradicts:
            gained = np.zeros(2)
        elif by_images is None:  # the first motion of a map
            gained = np.full(2, -rules.most_of_frame if contradicts else 0.0)
        else:
            gained = np.clip(found.weighed.log_likelihoods - by_images, -rules.most_of_frame, rules.most_of_frame)
        evenly = self.evenly.after(found.motion, found.seconds)
        turned_rad, log_ratio = float(np.linalg.norm(found.motion[3:])), self.log_ratio
        if min(turned_rad, found.turned_rad) > _LEAST_TURN_RAD:
            log_ratio += 0.2 * (np.log(found.turned_rad / turned_rad) - log_ratio)
        return changed(self._with_gained(gained, found.seconds), evenly=evenly, log_ratio=log_ratio)

    def _with_gained(self, gained: Array, seconds: float) -> "Belief":
        """Return the belief with more log odds (2,) after a time."""
        rules = self.rules
        sums = np.clip(np.array(self.log_odds) + gained, -rules.bound, rules.bound)
        contradicted = bool(sums.min() < 0)
        lasted_s = self.lasted_s + seconds if contradicted == self.contradicted else 0.0
        is_out = contradicted if lasted_s >= rules.lasting_s else self.is_out
        restarts = 0 if lasted_s >= rules.lasting_s and not contradicted else self.restarts
        odds = float(sums[0]), float(sums[1])
        return changed(self, log_odds=odds, lasted_s=lasted_s, is_out=is_out, restarts=restarts)

    def restarted(self) -> "Belief":
        """Return the belief after an impossible state: it has to be proven again; after the second one it is out."""
        odds = min(self.log_odds[0], 0.0), min(self.log_odds[1], 0.0)
        count = self.restarts + 1
        return changed(self, log_odds=odds, lasted_s=0.0, restarts=count, is_out=self.is_out or count > 1)

    def on_trial(self) -> "Belief":
        """Return the belief for samples that have to agree for a while before they are used."""
        return changed(self, log_odds=(0.0, 0.0), lasted_s=0.0, is_out=True)

    def interrupted(self) -> "Belief":
        """Return the belief where the motion before is not known, or may not be the camera's."""
        return changed(self, evenly=changed(self.evenly, velocity=None))

    @property
    def problem(self) -> str:
        """A sentence on what the samples do wrong."""
        if abs(self.log_ratio - np.log(_DEGREES)) < 0.5:
            return "the IMU contradicts the images: its rates are some 57 times too high, are they degrees per second?"
        return "the IMU contradicts the images"


@record
class Steadiness:
    """Whether gravity stays where it was: a bias that jumps or a wrong mounting moves it farther than its σ allows.

    `past`: stamps, gravity (3,) in axes of the world, and its covariance (3, 3), of the last second.
    """

    rules: InertiaRules
    past: tuple[tuple[int, Array, Array], ...] = ()

    def after(self, known: Known) -> tuple["Steadiness", bool]:
        """Return the record after a frame, and whether gravity has moved too far since any of its frames, eq. (85c)."""
        turn = known.world_from_cam[:3, :3]
        gravity = turn @ known.state[GRAVITY]
        cov = turn @ known.cov_state[GRAVITY, GRAVITY] @ turn.T
        since_ns = known.stamp_ns - round(self.rules.lasting_s * 1e9)
        past = tuple(row for row in self.past if row[0] >= since_ns)
        now = changed(self, past=(*past, (known.stamp_ns, gravity, cov)))
        if not past:
            return now, False
        moved = gravity - np.array([row[1] for row in past])
        values, axes = np.linalg.eigh(np.array([row[2] for row in past]) - cov)
        learnt = (axes * np.maximum(values, 0.0)[:, None]) @ np.swapaxes(axes, 1, 2)
        allowed = learnt + self.rules.unexplained * cov
        return now, bool(mahalanobis2(moved, allowed).max() > self.rules.moved)
