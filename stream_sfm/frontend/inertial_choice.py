"""Chooses between two motions that views agree with, if inertial samples allow only one of them."""

import numpy as np

from ..geometry import se3
from ..geometry.resection import Resection, refine
from ..record import changed
from ..types import ExpectedMotion
from .seen import Seen
from .state import FrontEndState
from .step import Step


def nearer(step: Step, state: FrontEndState, seen: Seen, motion: Resection) -> Resection:
    """Return the first or the second motion, whichever is nearer to the samples by both covariances, eq. (85).

    A motion that the samples do not allow is replaced by the one that they predict, if enough views agree with that. An
    accelerometer cannot distinguish a body in uniform motion from one at rest until it or the camera turns, or the
    velocity is known. The velocity is not known if a body may have been followed until now.
    """
    expected, second = step.by_inertia, motion.second
    if expected is None or not motion.ok:
        return motion
    if not _may_be(step, expected, motion):
        near = refine(seen.point_views, seen.weights, step.predicted, motion.amplitudes)
        if near.ok and is_sampled(step, near):
            return changed(near, second=None)
    if second is None or second.lasted:
        return motion
    other = refine(seen.point_views, seen.weights, second.cam_from_ref, motion.amplitudes)
    if not other.ok:
        return motion
    apart = step.setup.rules.motion.inertial_apart
    first, then = _distance2(expected, motion), _distance2(expected, other)
    if first - then > apart:
        return changed(other, second=None)
    return changed(motion, second=None) if then - first > apart else motion


def is_camera(step: Step, motion: Resection) -> bool:
    """Whether a motion agrees with samples from before the map began, so that it is not that of a body."""
    expected = step.by_inertia
    if expected is None or not expected.carried:
        return False
    return _distance2(expected, motion) < step.setup.rules.motion.inertial_near


def is_sampled(step: Step, motion: Resection) -> bool:
    """Whether a motion agrees with samples that have agreed with the images for a while, however few views show it."""
    expected = step.by_inertia
    if expected is None or not expected.agreed:
        return False
    return _distance2(expected, motion) < step.setup.rules.motion.inertial_near


def _may_be(step: Step, expected: ExpectedMotion, motion: Resection) -> bool:
    """Whether a motion is possible according to samples that have agreed with the images for a while."""
    rules = step.setup.rules.motion
    return not expected.agreed or _distance2(expected, motion) < rules.inertial_near + rules.inertial_apart


def _distance2(expected: ExpectedMotion, motion: Resection) -> float:
    apart = se3.log(se3.inverse(expected.previous_from_cam) @ se3.inverse(motion.cam_from_ref))
    return float(apart @ np.linalg.solve(expected.cov + motion.spread * motion.cov_pose, apart))
