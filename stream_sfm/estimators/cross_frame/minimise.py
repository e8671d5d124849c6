"""Gauss-Newton over the whole window, with views gated out by the joint minimum that they contradict."""

import numpy as np

from ...config import WindowConfig
from .map import Map
from .velocities import is_timed, renew_timing


def minimise(current: Map, rules: WindowConfig, gate_probability: float) -> int:
    """Go to the joint minimum of the window and return the number of steps.

    Views that contradict it have no part in the next step, of this frame or of the next one. Where the timing is wrong,
    a second step is made with the velocities that the first one has found. The last factor stays in the map for the
    covariances. Raises LinAlgError where the iteration diverges or no points are left.
    """
    before, steps, timed = np.inf, 0, is_timed(current)
    while steps < rules.max_iterations and not (before < rules.converged and steps >= 1 + timed):
        current.drop_undetermined()
        if not len(current.points):
            raise np.linalg.LinAlgError("no points are left")
        decrease = current.gauss_newton_step()
        # A step that promises more than the one before it leads away from the minimum. After convergence the only step
        # is that for new velocities, which may have moved the minimum a little.
        if not decrease < max(before, rules.converged):
            raise np.linalg.LinAlgError("Gauss-Newton diverges")
        current.gate(gate_probability)  # by the velocities that this minimum is of
        if timed:
            renew_timing(current)
        before, steps = decrease, steps + 1
    return steps
