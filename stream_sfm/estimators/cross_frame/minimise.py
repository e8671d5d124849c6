"""Gauss-Newton over the whole window, with views gated out by the joint minimum that they contradict."""

import numpy as np

from ...geometry.gates import chi2_gates
from .inverse_depth import WhitenedViews, whitened_residuals
from .map import Map

# Decreases of the sum of squares that a step promises, in squared standard deviations. One that promises more than
# this, and more than the step before it, leads away from the minimum.
_DIVERGED = 1e3
# Measured on simulated and real views: a step leaves less than a ten-thousandth of the decrease it promised. After one
# that promised this much, a standard deviation at most is left, all variables together; the next frame goes on from
# there. A tenth of it changes the figures of eight logs in the third digit, and takes 8 % more time.
_CONVERGED = 1e4


def minimise(current: Map, max_iterations: int, gate_probability: float) -> int:
    """Go to the joint minimum of the window and return the number of steps.

    Views that contradict it have no part in the next step, of this frame or of the next one. The last factor stays in
    the map for the covariances. Raises LinAlgError where the iteration diverges or no points are left.
    """
    before, steps = np.inf, 0
    while steps < max_iterations and not before < _CONVERGED:
        current.drop_undetermined()
        if not len(current.ids):
            raise np.linalg.LinAlgError("no points are left")
        views = current.views()
        decrease = current.gauss_newton_step(views)
        if not decrease < max(before, _DIVERGED):
            raise np.linalg.LinAlgError("Gauss-Newton diverges")
        _gate(current, views, gate_probability)
        before, steps = decrease, steps + 1
    return steps


def _gate(current: Map, views: WhitenedViews, gate_probability: float) -> None:
    """Take the views that the joint minimum contradicts out of use, each by its own covariance."""
    r = whitened_residuals(
        current.projection, current.cams_from_ref(), current.ref_from_anchor, current.q, current.rig_error, views
    )
    r /= views.weight
    both_sides = views.root[:, 2, 2] != 0
    bad = (r * r).sum(axis=1) > chi2_gates(np.where(both_sides, 4, 2), gate_probability)
    for row, track_id in zip(views.frame[bad].tolist(), current.ids[views.point[bad]].tolist(), strict=True):
        frame = current.frames[row]
        frame.used[np.searchsorted(frame.ids, track_id)] = False
        current.rejections.add(track_id)
