"""Drift inside the window: what the covariance knows of patches that slide over their surfaces between its frames.

The minimum takes the points of the window for fixed, which measured to be as accurate or better; but with a map's first
frames the covariance would then be much too small.
"""

from dataclasses import replace

import numpy as np

from ...geometry.linear import symmetric
from ...geometry.se3 import Array
from .inverse_depth import NormalBlocks

# Of the variance per step that the prior takes in, eq. (33). The steps of one patch have one cause, the slant that its
# warp does not know, so within some frames they add up to less than in the long run. Measured over 30 starts on five
# rendered logs, mean NEES of a map's first ten frames, 6 expected: with nothing 5.6 to 18, with a quarter 2.4 to 4.7,
# with all of it 1.0 to 3.9.
DRIFT_WITHIN_WINDOW = 0.25


def with_drift(blocks: NormalBlocks, drift: Array) -> NormalBlocks:
    """Return the normal equations for points that take independent steps between frames, eq. (28a).

    `drift` (F, P, 3, 3): covariance of each point's step up to each frame; zero where a point begins. The steps are
    marginalised from the newest frame backwards: each weakens all that later views say about the point, and couples
    their poses. Of the result, q is the point before all steps; right-hand sides stay as they are.
    """
    frames, points = len(blocks.u), len(blocks.v)
    n = 6 * frames
    by_frame = blocks.w.reshape(points, 3, frames, 6)
    coupling = np.zeros((n, n))
    later = np.zeros((points, 3, n + 3))  # of frames from s on: blocks against the poses, and of the point
    for s in range(frames - 1, -1, -1):
        first = 6 * s
        later[:, :, first : first + 6] = by_frame[:, :, s]
        later[:, :, n:] += blocks.v_by_frame[s]
        rows = np.flatnonzero(drift[s, :, 0, 0] > 0)
        if not len(rows):
            continue
        step, known = drift[s, rows], later[rows, :, first:]
        shrink = np.linalg.inv(np.eye(3) + known[:, :, -3:] @ step)
        against = known[:, :, :-3]
        flat = (3 * len(rows), n - first)
        coupling[first:, first:] -= against.reshape(flat).T @ ((step @ shrink) @ against).reshape(flat)
        later[rows, :, first:] = shrink @ known
    return replace(blocks, v=symmetric(later[:, :, n:]), w=later[:, :, :n], coupling=coupling)
