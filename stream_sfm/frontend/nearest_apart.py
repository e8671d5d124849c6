"""Checks at the start of a map whether the nearest points that agree with a motion are on a moving body.

Far points agree with any translation that a rotation compensates. So while no track has a history, all far points may
agree with the motion of a body in front of the camera. Only the points in between contradict it, and they are too few
for a second motion.
"""

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..config.rules import StartRules
from ..geometry import Array
from ..geometry.medians import median
from ..geometry.resection import MANY_VIEWS, MIN_VIEWS, Resection, SecondMotion, refine, resect
from ..record import changed
from .depth_order import is_behind
from .seen import Seen
from .state import FrontEndState
from .step import Step


def of_rest(step: Step, state: FrontEndState, seen: Seen, motion: Resection) -> Resection:
    """Return the motion of all but the nearest points, if it explains them clearly better and they lie behind these.

    It is found from the far half of the agreeing points and from those that disagree. Errors that the views share count
    against it. The noise of its own views is the measure of a clear gain.
    """
    if state.start.is_over or not motion.ok or motion.second is not None:
        return motion
    views, rho = seen.point_views, seen.before.points[:, 3]
    rest = ~(motion.accepted & (rho >= median(rho[motion.accepted])))
    if np.count_nonzero(rest) < MANY_VIEWS:
        return motion
    alone = resect(views.select(rest), motion.cam_from_ref, seen.weights[rest], find_second=False, search=True)
    other = refine(views, seen.weights, alone.cam_from_ref, alone.amplitudes)
    if not alone.ok or not other.ok:
        return motion
    limit = views.clear_gate
    only_first = motion.accepted & (other.squared_residuals > limit)
    noise = other.chi2 / other.dof  # over that assumed, where the other motion is right
    only_other = other.accepted & (motion.squared_residuals > noise * limit)
    tracks, clear = seen.before, step.setup.rules.start.clear_views * float(limit.max())
    if _gain(motion, other, limit) < noise * clear:
        return motion
    if not is_behind(step.setup, tracks.keep(only_other), tracks.keep(only_first), fewest=MIN_VIEWS):
        return motion
    return changed(other, second=SecondMotion(motion.cam_from_ref, motion.cov_pose, only_first, 0.0, in_front=True))


def _gain(motion: Resection, other: Resection, limit: Array) -> float:
    """Return by how much better another motion explains its views, including shared errors; eq. (23d).

    Squared residuals under the first motion count up to a `limit` (n,).
    """
    views = np.minimum(motion.squared_residuals, limit) - other.squared_residuals
    shared = motion.amplitudes @ motion.amplitudes - other.amplitudes @ other.amplitudes
    return float(views[other.accepted].sum() + shared)


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
