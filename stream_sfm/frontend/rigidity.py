"""The motion of one rigid scene, where a body and the background agree with a motion between theirs.

A body nearby and a background far away may agree with one motion, each view within its noise, all together not at all.
Halves of the views tell: near and far, left and right, upper and lower ones give the same motion in a scene that stands
still. Where they do not, the motion is sought again from that of each half, and from the predicted one.
"""

from dataclasses import replace

import numpy as np

from .. import core
from ..geometry.point_views import PointViews
from ..geometry.resection import BEYOND, MIN_SECOND_VIEWS, MIN_VIEWS, Resection, SecondMotion, refine
from ..geometry.se3 import Array

# Squared distance of the motions of two halves in standard deviations, 6 expected. Frames that a body leads have 13 to
# 140. So have some of a sample log whose calibration errs, but no motion there leaves views out.
_APART = 12.0
_SHARED = 0.01  # of a view's variance: errors that all views of a half share, of calibration above all
# Of the evidence of what is left out over that of the rest: bodies have .05 to .3, halves of a drone's last frames 1.
_MAX_ODDS = 0.5
_LEAST = 4 * MIN_VIEWS  # views; fewer do not make two halves


def rigid_motion(views: PointViews, weights: Array, found: Resection, predicted: Array) -> Resection:
    """Return the motion found, or another one: of one rigid body only, which leaves out views that the first one took.

    Of several the one with the most evidence is taken, with views weighted (n,) as for `found`.
    """
    apart, halves = _halves(views, found)
    if apart < _APART:
        return found
    best, most = found, 0.0
    for cam_from_ref in [predicted, *halves]:
        other = refine(views, weights, cam_from_ref, found.amplitudes)
        left_out = found.accepted & (other.squared_residuals > BEYOND * views.gate)
        says = views.evidence(weights * other.accepted)
        if not other.ok or left_out.sum() < MIN_SECOND_VIEWS or says <= most:
            continue
        if _halves(views, other)[0] < _APART:
            odds = views.evidence(weights * left_out) / says
            if odds > _MAX_ODDS:
                continue
            second = SecondMotion(found.cam_from_ref, found.cov_pose, left_out, odds)
            best, most = replace(other, second=second), says
    return best


def _halves(views: PointViews, motion: Resection) -> tuple[float, Array]:
    """Return the largest distance between motions of halves of the accepted views, and all these motions (k, 4, 4)."""
    if motion.accepted.sum() < _LEAST:
        return 0.0, np.empty((0, 4, 4))
    return core.motions_of_halves(views.of_core, motion.cam_from_ref, motion.amplitudes, motion.accepted, _SHARED)
