"""The input of one step of the front-end: a frame, and the expected camera motion up to it."""

import math

import numpy as np

from ..geometry import Array, se3
from ..geometry.resection import Resection
from ..pictures.prepared import PreparedImages
from ..record import record
from ..types import ExpectedMotion
from .learnt.timing import TurningError
from .rules import MotionRules
from .second_motions.unsteadiness import Unsteadiness
from .state import FrontEndState, Setup


@record
class Step:
    """The images of the `previous` frame, and the `images` of this one, `dt_s` later.

    `predicted` (4, 4): cam_from_previous by the last velocity, or from inertial samples if they predict it
    (`by_inertia`); `is_predicted`: whether any motion is known.
    """

    setup: Setup
    previous: PreparedImages
    images: PreparedImages
    dt_s: float
    predicted: Array
    is_predicted: bool
    by_inertia: ExpectedMotion | None

    @classmethod
    def of(
        cls,
        setup: Setup,
        state: FrontEndState,
        images: PreparedImages,
        stamp_ns: int,
        by_inertia: ExpectedMotion | None,
    ) -> "Step | None":
        """Return the step from a state to a frame; None if there is nothing to follow."""
        if state.previous is None or not len(state.tracks):
            return None
        dt_s = (stamp_ns - state.previous_ns) / 1e9
        predicted, is_predicted = se3.exp(state.velocity * dt_s), bool(state.velocity.any())
        if by_inertia is not None:
            predicted, is_predicted = se3.inverse(by_inertia.previous_from_cam), True
        return cls(setup, state.previous, images, dt_s, predicted, is_predicted, by_inertia)

    @property
    def std_change(self) -> Array:
        """The σ (6,) of a change of motion between the two frames by the assumed acceleration."""
        return self.setup.std_acceleration * self.dt_s**2

    def usual_change(self, unsteadiness: Unsteadiness | None) -> Array:
        """Return the σ (6,) of a change of motion of this camera, if it is known to be steadier than assumed."""
        return self.std_change if unsteadiness is None else np.minimum(self.std_change, unsteadiness.std)

    def jumps(self, cam_from_previous: Array, std_change: Array) -> bool:
        """Whether a motion (4, 4) differs from the predicted one by more than changes of σ (6,) allow."""
        change = se3.log(se3.inverse(self.predicted) @ cam_from_previous)
        return bool((np.abs(change) > self.setup.rules.of(MotionRules).jump_sigmas * std_change).any())

    def twist(self, velocity: Array, cam_from_previous: Array) -> Array:
        """Return the twist (6,) of the points at the end of the interval; `velocity` (6,): in the previous interval."""
        between = se3.log(cam_from_previous) / self.dt_s
        twist = between + 0.5 * (between - velocity) if velocity.any() else between
        if self.by_inertia is None:
            return twist
        # two frames do not show the current rotation of a shaken camera
        return np.concatenate([twist[:3], self.by_inertia.twist[3:]])

    def first_twist(self, twist: Array, cam_from_previous: Array) -> Array:
        """Return the twist (6,) of the points at the beginning of the first interval; `twist`: at its end.

        Without inertial samples, two frames show only one twist for both ends.
        """
        if self.by_inertia is None:
            return twist
        return 2 * se3.log(cam_from_previous) / self.dt_s - twist

    def std_turning(self, error: TurningError) -> float:
        """Return σ of the rotation of a twist about each axis, rad/s: a gyroscope measures it."""
        return math.sqrt(error.mean_square) if self.by_inertia is None else 0.0

    @property
    def agreed_samples(self) -> ExpectedMotion | None:
        """The motion by inertial samples if these have agreed with the images for a while; otherwise None."""
        return self.by_inertia if self.by_inertia is not None and self.by_inertia.agreed else None

    def cov_predicted(self, unsteadiness: Unsteadiness | None) -> Array:
        """Return the covariance (6, 6) of the predicted motion by such samples, or by the usual changes of motion."""
        samples = self.agreed_samples
        return np.diag(self.usual_change(unsteadiness) ** 2) if samples is None else samples.cov

    def distance2(self, motion: Resection, cov_predicted: Array) -> float:
        """Return the squared distance of a motion from the predicted one, by both covariances, eq. (85)."""
        apart = se3.log(self.predicted @ se3.inverse(motion.cam_from_ref))
        return float(apart @ np.linalg.solve(cov_predicted + motion.spread * motion.cov_pose, apart))

    def is_sampled(self, motion: Resection) -> bool:
        """Whether a motion agrees with samples that have agreed before, so that it is the camera's."""
        samples, near = self.agreed_samples, self.setup.rules.of(MotionRules).expected_near
        return samples is not None and self.distance2(motion, samples.cov) < near
