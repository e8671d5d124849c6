"""The motion of one rigid scene, where a body and the background agree with a motion between theirs.

A body nearby and a background far away may agree with one motion, each view within its noise, all together not at all.
Halves of the views tell: near and far, left and right, upper and lower ones give the same motion in a scene that stands
still. Where they do not, the motion is sought again from that of each half, and from the predicted one.
"""

from dataclasses import replace

import numpy as np

from ..geometry import se3
from ..geometry.linear import damped_solve
from ..geometry.motion_search import evidence
from ..geometry.point_views import PointViews
from ..geometry.resection import BEYOND, MIN_SECOND_VIEWS, MIN_VIEWS, Resection, SecondMotion, refine
from ..geometry.se3 import Array

# Squared distance of the motions of two halves in standard deviations, 6 expected. Frames that a body leads have 13 to
# 140. So have some of a sample log whose calibration errs, but no motion there leaves views out.
_APART = 12.0
_SHARED = 0.01  # of a view's variance: errors that all views of a half share, of calibration above all
# Of the evidence of what is left out over that of the rest: bodies have .05 to .3, halves of a drone's last frames 1.
_MAX_ODDS = 0.5
_LEAST = 4 * MIN_VIEWS  # views: fewer are no two halves


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
        says = evidence(views, weights * other.accepted)
        if not other.ok or left_out.sum() < MIN_SECOND_VIEWS or says <= most:
            continue
        if _halves(views, other)[0] < _APART:
            odds = evidence(views, weights * left_out) / says
            if odds > _MAX_ODDS:
                continue
            second = SecondMotion(found.cam_from_ref, found.cov_pose, left_out, odds)
            best, most = replace(other, second=second), says
    return best


def _halves(views: PointViews, motion: Resection) -> tuple[float, list[Array]]:
    """How far apart the motions of halves of the accepted views are at most, and all these motions (4, 4)."""
    agree, n = motion.accepted, int(motion.accepted.sum())
    if n < _LEAST:
        return 0.0, []
    root, j = views.linearise(motion.cam_from_ref)
    r, _ = views.residuals(motion.cam_from_ref, root, motion.amplitudes)
    j, r, m = j[agree], r[agree], j.shape[2]
    information = np.diag(np.repeat([0.0, 1.0], [6, m - 6]))  # of the errors that all share
    information += j.reshape(-1, m).T @ j.reshape(-1, m)
    apart, motions = 0.0, []
    for of_view in (views.points[agree, 3], views.z[agree, 0], views.z[agree, 1]):
        half = np.argpartition(of_view, n // 2)[n // 2 :]
        j_half, r_half = j[half].reshape(-1, m), r[half].ravel()
        of_half = j_half.T @ j_half[:, :6]
        h = np.block([[information, of_half], [of_half.T, of_half[:6]]])
        # the motion is at the minimum of all views, that of the half is not
        g = np.concatenate([np.zeros(m), r_half @ j_half[:, :6]])
        x = damped_solve(h, g)
        apart = max(apart, float(g @ x) / (1 + _SHARED * n))
        motions += [se3.exp(step) @ motion.cam_from_ref for step in (x[:6], x[:6] + x[m:])]
    return apart, motions
