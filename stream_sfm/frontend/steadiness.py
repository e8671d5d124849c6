"""Chooses between two motions that tracks with a history agree with: the steady one is the camera's.

A body that comes into view has its own motion, and far points of the background agree with it within their noise. If it
were the camera's, the camera would have jumped. If there was no ambiguity before, and many old tracks continue as
before, such a motion is that of a body.
"""

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..geometry import Array, se3
from ..geometry.medians import median
from ..geometry.point_views import PointViews
from ..geometry.resection import MANY_VIEWS, MIN_VIEWS, Resection, SecondMotion, expected, judged, refine
from ..record import changed
from .seen import Seen
from .state import FrontEndState
from .step import Step


def steadier(step: Step, state: FrontEndState, seen: Seen, motion: Resection) -> Resection:
    """Return the motion near the predicted one in place of one that jumps, if about as many old tracks agree.

    The motion that jumps then becomes the second motion.
    """
    usual = step.usual_change(state.unsteadiness)
    if not motion.ok or not step.jumps(motion.cam_from_ref, usual):
        return motion
    if motion.second is not None and motion.second.in_front:  # the tracks followed so far are then on a body
        return motion
    views, old = seen.point_views, seen.before.agreed > 0
    fewest = views.settings.second_views
    near = _near(step, seen, old, usual)
    agree, agreed = (int(np.count_nonzero(m.accepted & old)) for m in (near, motion))
    if not near.ok or agree < max(fewest, step.setup.rules.motion.as_many * agreed):
        return motion
    only_other = motion.accepted & (near.squared_residuals > views.clear_gate)
    if np.count_nonzero(only_other) < fewest:  # few views distinguish the two
        return changed(near, second=motion.second) if near.share >= motion.share else motion
    return changed(near, second=SecondMotion(motion.cam_from_ref, motion.cov_pose, only_other, odds=1.0))


def _near(step: Step, seen: Seen, old: NDArray[np.bool_], std_change: Array) -> Resection:
    """Return the motion near the predicted one, from `old` tracks (n,), or from those with a full history if many.

    `std_change` (6,): σ of a change from the prediction. If these tracks do not determine it, all views are used.
    """
    views, start = seen.point_views, step.predicted
    none, settled = np.zeros(views.shared.shape[2]), seen.before.agreed >= step.setup.rules.motion.full_history
    if np.count_nonzero(settled) >= MANY_VIEWS:
        old = settled
    if np.count_nonzero(old) >= MIN_VIEWS:
        of_old = views.select(old)
        start = _turned(of_old, start)
        alone = refine(of_old, seen.weights[old], start, none)
        # far tracks alone determine a motion poorly
        std_alone = np.sqrt(std_change**2 + np.diagonal(alone.cov_pose))
        if alone.ok and not step.jumps(alone.cam_from_ref, std_alone):
            return judged(expected(alone, start, std_change), views, seen.weights)
    return refine(views, seen.weights, start, none)


def _turned(views: PointViews, cam_from_ref: Array) -> Array:
    """Return a motion (4, 4) with the rotation that fits most of the views (n), its translation unchanged.

    The rotation of a hand-held camera between two frames cannot be predicted to a pixel.
    """
    found, none = cam_from_ref, np.zeros(views.shared.shape[2])
    for _ in range(5):  # Gauss-Newton steps, each with robust weights
        root, jacobian = views.linearise(found)
        residuals, squared = (of_motion[0] for of_motion in core.view_residuals(views, root, none, found[None]))
        finite = np.isfinite(squared)
        if np.count_nonzero(finite) < MIN_VIEWS:
            return cam_from_ref
        weights = np.where(finite, 1 / (1 + squared / max(median(squared[finite]), 1.0)), 0.0)
        by_turn = jacobian[finite, :, 3:6]
        weighted = weights[finite, None, None] * by_turn
        turn = np.linalg.solve(
            np.einsum("nki,nkj->ij", weighted, by_turn) + np.eye(3),  # definite, even if views determine no turn
            np.einsum("nki,nk->i", weighted, residuals[finite]),
        )
        found = se3.exp(np.concatenate([np.zeros(3), turn])) @ found
        found[:3, 3] = cam_from_ref[:3, 3]
    return found


def without_newcomer(step: Step, state: FrontEndState, seen: Seen, motion: Resection) -> Resection:
    """Return a steady motion without ambiguity, if the second motion is that of a newcomer.

    This is so if many old tracks agree with the first motion, and hardly any with the second one only. The speed of the
    second motion is no evidence, because a body may pass slowly. (If the newcomer lies behind everything else,
    `uncovered` makes the motion ambiguous again.)
    """
    second, old = motion.ambiguous, seen.before.agreed >= step.setup.rules.motion.full_history
    if second is None or not state.start.is_over or state.ambiguity.frames_left > 0:
        return motion
    if step.jumps(motion.cam_from_ref, step.std_change) or np.count_nonzero(second.views & old) >= MIN_VIEWS:
        return motion
    if np.count_nonzero(motion.accepted & old) < MANY_VIEWS:
        return motion
    return changed(motion, second=changed(second, odds=0.0))
