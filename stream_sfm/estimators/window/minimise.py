"""Gauss-Newton over the whole window; views that contradict the joint minimum are gated out."""

import numpy as np

from ... import core
from ...config import WindowConfig
from ...geometry.gates import chi2_gate
from ...record import changed
from .normal_equations import System
from .state import WindowState
from .unknowns.velocities import is_timed, renewed_timing

# Views that a minimum gates out, and new velocities, enlarge the decrease that the next step predicts. One that is
# smaller than this, σ², is that of such a change: at most one standard deviation is left after the step.
_CHANGED = 1e4
_NOT_INERTIAL = np.zeros((0, 0)), np.zeros(0)


def minimised(current: WindowState, rules: WindowConfig, gate_probability: float) -> tuple[WindowState, int]:
    """Return the state at the joint minimum of the window, and the number of steps.

    Views that contradict the minimum are not used in later steps, of this frame or of later ones. If the timing is
    wrong, a second step uses the velocities found by the first one. The last factored system stays in the state for the
    covariances. Raises LinAlgError if the iteration diverges or no points are left.
    """
    before, steps, timed = np.inf, 0, is_timed(current)
    while steps < rules.max_iterations and not (before < rules.converged and steps >= 1 + timed):
        current = without_undetermined(current)
        if not len(current.points):
            raise np.linalg.LinAlgError("no points are left")
        current, decrease = gauss_newton_step(current)
        # If a step predicts a larger decrease than the one before, the iteration diverges.
        if not decrease < max(before, rules.converged, _CHANGED):
            raise np.linalg.LinAlgError("Gauss-Newton diverges")
        current = gated(current, gate_probability)  # with the velocities of this minimum
        if timed:
            current = renewed_timing(current)
        before, steps = decrease, steps + 1
    return current, steps


def gauss_newton_step(current: WindowState) -> tuple[WindowState, float]:
    """Move poses, points and modes by one step, and return the predicted decrease of the sum of squares."""
    after, solved, decrease = stepped(current, with_rig=True)
    return changed(after, solved=System.of(current.prior, current.points.ids, solved, current.own.size)), decrease


def stepped(current: WindowState, with_rig: bool) -> tuple[WindowState, core.SolvedWindow, float]:
    """Return the state after one step, the factored normal equations, and the predicted decrease.

    Without `with_rig` the rig's errors are not among the unknowns, and stay where they are.
    """
    about = _NOT_INERTIAL
    if current.inertia is not None and current.frames:
        inertia, about = current.inertia.linearised(current.cams_from_ref, current.inertial_state)
        current = changed(current, inertia=inertia)
    solved, after, decrease = core.window_step(
        *(current.projection, current.state, current.views, current.prior, current.amplitudes, with_rig), *about
    )
    return current.moved(after), solved, decrease


def without_undetermined(current: WindowState) -> WindowState:
    """Drop points that neither the prior nor an accepted stereo view of the window determines.

    Points that ended after a single view are dropped too, as one view contains no information about anything else.
    """
    views, points, known = current.views, current.points, current.prior.ids
    keep = core.determined_points(points.ids, known, views.ids, views.used, views.stereo, current.newest.start)
    if keep.all():
        return current
    points = points.keep(keep)
    return changed(current, points=points, views=changed(views, used=views.used & core.among(views.ids, points.ids)))


def gated(current: WindowState, probability: float) -> WindowState:
    """Stop using the views that contradict the joint minimum, each by its own covariance and slide, eq. (26a)."""
    views, gates = current.views, (chi2_gate(2, probability), chi2_gate(4, probability))
    used = core.views_within_gates(current.projection, current.state, views, views.var_drift, *gates)
    rejections = current.rejections.with_more(views.ids[views.used & ~used])
    return changed(current, rejections=rejections, views=changed(views, used=used))
