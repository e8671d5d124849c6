"""Of two motions that tracks with a history agree with, the one that goes on as before is the camera's.

A body that comes into view has points with a motion of their own, and far points of the background agree with that as
well, within their noise. To follow it the camera would have to jump. Where nothing was in question before, and many old
tracks go on as before, such a motion is that of a body.
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
    """Return the motion near the predicted one in place of one that jumps, if as many old tracks agree.

    What jumps is then the second motion.
    """
    usual = step.usual_change(state.unsteadiness)
    if not motion.ok or not step.jumps(motion.cam_from_ref, usual):
        return motion
    if motion.second is not None and motion.second.in_front:  # what was followed is a body then
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
    """Return the motion near the predicted one: that of `old` tracks (n,), or of many with a full history.

    `std_change` (6,): σ of a change from the prediction. Where these tracks do not determine it, all views do.
    """
    views, start = seen.point_views, step.predicted
    none, settled = np.zeros(views.shared.shape[2]), seen.before.agreed >= step.setup.rules.motion.full_history
    if np.count_nonzero(settled) >= MANY_VIEWS:
        old = settled
    if np.count_nonzero(old) >= MIN_VIEWS:
        of_old = views.select(old)
        start = _turned(of_old, start)
        alone = refine(of_old, seen.weights[old], start, none)
        # far tracks leave much open by themselves
        std_alone = np.sqrt(std_change**2 + np.diagonal(alone.cov_pose))
        if alone.ok and not step.jumps(alone.cam_from_ref, std_alone):
            return judged(expected(alone, start, std_change), views, seen.weights)
    return refine(views, seen.weights, start, none)


def _turned(views: PointViews, cam_from_ref: Array) -> Array:
    """Return a motion (4, 4) with the rotation that suits most of the views (n) at its translation.

    Between two frames a camera that is carried turns by more than a prediction knows to a pixel.
    """
    found, none = cam_from_ref, np.zeros(views.shared.shape[2])
    for _ in range(5):  # steps of Gauss-Newton, each with robust weights
        root, jacobian = views.linearise(found)
        residuals, squared = (of_motion[0] for of_motion in core.view_residuals(views, root, none, found[None]))
        finite = np.isfinite(squared)
        if np.count_nonzero(finite) < MIN_VIEWS:
            return cam_from_ref
        weights = np.where(finite, 1 / (1 + squared / max(median(squared[finite]), 1.0)), 0.0)
        by_turn = jacobian[finite, :, 3:6]
        weighted = weights[finite, None, None] * by_turn
        turn = np.linalg.solve(
            np.einsum("nki,nkj->ij", weighted, by_turn) + np.eye(3),  # definite, also where views leave a turn open
            np.einsum("nki,nk->i", weighted, residuals[finite]),
        )
        found = se3.exp(np.concatenate([np.zeros(3), turn])) @ found
        found[:3, 3] = cam_from_ref[:3, 3]
    return found


def without_newcomer(step: Step, state: FrontEndState, seen: Seen, motion: Resection) -> Resection:
    """Return a motion that goes on as before with a second one no longer in question, if that came anew.

    That is: many old tracks agree with the first motion, and hardly any with the second one only. How fast that is says
    nothing: a body may pass slowly. (What comes into view behind all of it is in question again, by `uncovered`.)
    """
    second, old = motion.ambiguous, seen.before.agreed >= step.setup.rules.motion.full_history
    if second is None or not state.start.is_over or state.ambiguity.frames_left > 0:
        return motion
    if step.jumps(motion.cam_from_ref, step.std_change) or np.count_nonzero(second.views & old) >= MIN_VIEWS:
        return motion
    if np.count_nonzero(motion.accepted & old) < MANY_VIEWS:
        return motion
    return changed(motion, second=changed(second, odds=0.0))
