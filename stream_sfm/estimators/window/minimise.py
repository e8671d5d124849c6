"""Gauss-Newton over the whole window; views that contradict the joint minimum are gated out."""

import numpy as np

from ...config import WindowConfig
from .map import Map
from .unknowns.velocities import is_timed, renew_timing

# Views that a minimum gates out, and new velocities, enlarge the decrease that the next step predicts. One that is
# smaller than this, σ², is that of such a change: at most one standard deviation is left after the step.
_CHANGED = 1e4


def minimise(current: Map, rules: WindowConfig, gate_probability: float) -> int:
    """Move the map to the joint minimum of the window and return the number of steps.

    Views that contradict the minimum are not used in later steps, of this frame or of later ones. If the timing is
    wrong, a second step uses the velocities found by the first one. The last factored system stays in the map for the
    covariances. Raises LinAlgError if the iteration diverges or no points are left.
    """
    before, steps, timed = np.inf, 0, is_timed(current)
    while steps < rules.max_iterations and not (before < rules.converged and steps >= 1 + timed):
        current.drop_undetermined()
        if not len(current.points):
            raise np.linalg.LinAlgError("no points are left")
        decrease = current.gauss_newton_step()
        # If a step predicts a larger decrease than the one before, the iteration diverges.
        if not decrease < max(before, rules.converged, _CHANGED):
            raise np.linalg.LinAlgError("Gauss-Newton diverges")
        current.gate(gate_probability)  # with the velocities of this minimum
        if timed:
            renew_timing(current)
        before, steps = decrease, steps + 1
    return steps
