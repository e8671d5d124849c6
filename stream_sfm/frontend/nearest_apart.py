"""Checks at the start of a map whether points that agree with a motion are on a body in front of the scene.

Far points agree with any translation that a rotation compensates. So while no track has a history, all far points may
agree with the motion of a body in front of the camera, or of the robot's own body, which is at rest in the image. Only
the points in between contradict it, and they are too few for a second motion, or each of them by too little.
"""

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..config.rules import StartRules
from ..geometry import Array
from ..geometry.medians import median
from ..geometry.resection import MANY_VIEWS, Resection, SecondMotion, refine, resect, residuals_of
from ..record import changed
from .depth_order import is_behind
from .seen import Seen
from .state import FrontEndState
from .step import Step


def of_rest(step: Step, state: FrontEndState, seen: Seen, motion: Resection) -> Resection:
    """Return the motion without some of the points, if it explains all others clearly better and these are in front.

    They are those at rest in the image, or the nearer half of those that agree.
    """
    if state.start.is_over or not motion.ok:
        return motion
    views, rho = seen.point_views, seen.before.points[:, 3]
    at_rest = residuals_of(views, np.eye(4)) < views.gate
    moving = np.count_nonzero(motion.accepted & ~at_rest)
    if moving > np.count_nonzero(motion.accepted & at_rest):  # otherwise the camera is at rest
        motion = _without(step, seen, motion, at_rest)
    if motion.second is not None:
        return motion
    return _without(step, seen, motion, motion.accepted & (rho >= median(rho[motion.accepted])))


def _without(step: Step, seen: Seen, motion: Resection, apart: NDArray[np.bool_]) -> Resection:
    """Return the motion of the points (n) that are not `apart` (n,), if the points only of the other are a body."""
    views, rest, rules = seen.point_views, ~apart, step.setup.rules
    if np.count_nonzero(motion.accepted & rest) < MANY_VIEWS or not (motion.accepted & apart).any():
        return motion
    alone = resect(views.select(rest), motion.cam_from_ref, seen.weights[rest], find_second=False, search=True)
    other = refine(views, seen.weights, alone.cam_from_ref, alone.amplitudes)
    if not alone.ok or not other.ok:
        return motion
    body = motion.accepted & (other.squared_residuals > views.clear_gate)
    scene = other.accepted & ~apart
    if np.count_nonzero(scene & motion.accepted) < rules.motion.as_many * np.count_nonzero(motion.accepted & rest):
        return motion  # the motion of other points than these
    if log_odds(motion, other, ~body, views.clear_gate) < rules.start.body:
        return motion
    if not is_behind(step.setup, seen.before.keep(scene), seen.before.keep(body), fewest=1):
        return motion
    return changed(other, second=SecondMotion(motion.cam_from_ref, motion.cov_pose, body, 0.0, in_front=True))


def log_odds(motion: Resection, other: Resection, rows: NDArray[np.bool_], limit: Array) -> float:
    """Return the log-odds of another motion over one by the views `rows` (n,), eq. (23d).

    Residuals are measured in the noise that the views of the other motion show. Squared ones count up to a `limit`
    (n,), so that views of neither motion say nothing.
    """
    noise = other.chi2 / max(other.dof, 1)
    first, then = (np.minimum(m.squared_residuals[rows] / noise, limit[rows]) for m in (motion, other))
    shared = motion.amplitudes @ motion.amplitudes - other.amplitudes @ other.amplitudes
    return 0.5 * float((first - then).sum() + shared)


def contradict_far(
    rules: StartRules, seen: Seen, motion: Resection, others: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which of `others` (n,), which may belong to the scene, contradict the agreeing points behind them.

    If the motion were that of a body in front of the scene, agreeing points farther away than these others would belong
    to the scene. So the others are tested against the motion of these far points, with its covariance.
    """
    views, rho, none = seen.point_views, seen.before.points[:, 3], np.zeros(len(others), bool)
    if not others.any():
        return none
    far = motion.accepted & (rules.deeper * rho < median(rho[others]))
    if np.count_nonzero(far) < MANY_VIEWS:
        return none
    by_far = refine(views.select(far), seen.weights[far], motion.cam_from_ref, motion.amplitudes)
    if not by_far.ok:
        return none
    rows = views.select(others)
    root, jacobian = rows.linearise(by_far.cam_from_ref)
    residuals = core.view_residuals(rows, root, by_far.amplitudes, by_far.cam_from_ref[None])[0][0]
    cov = np.zeros((jacobian.shape[2],) * 2)
    cov[:6, :6], cov[6:, 6:] = by_far.cov_pose, by_far.cov_amplitudes
    cov_residuals = np.eye(4) + jacobian @ cov @ np.swapaxes(jacobian, 1, 2)
    squared = np.einsum("ni,ni->n", residuals, np.linalg.solve(cov_residuals, residuals[:, :, None])[:, :, 0])
    none[others] = squared > rows.clear_gate
    return none
