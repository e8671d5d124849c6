"""Reads one solution in two ways: CC (structure in the newest camera) and WC (pose and structure in the world).

Both come from the same joint covariance of poses, points and world, so they are consistent with each other: eqs. (37)
and (38), and eqs. (39)–(41).
"""

import numpy as np
from numpy.typing import NDArray

from .... import core
from ....geometry import Array, se3
from ....geometry.stereo import KNOWN_DEPTH_SIGMAS
from ....record import changed, columns_at, filled, record
from ...lifecycle import WorldPoints
from ..inverse_depth import State
from ..normal_equations import System

_NO_IDS = np.empty(0, np.int64)


@record
class Marginals:
    """Marginal estimates of the newest pose and of all points of the map (n).

    `q_in_cam`: q in the newest camera; metric points in that camera and in the world; each with its covariance. That of
    q is given the rig's errors, as they have the same effect on the next views of the points and cancel between two
    frames. `finite` (n,) bool: the depth is known well enough for metric points; the metric rows of the others are
    meaningless.
    """

    ids: NDArray[np.int64]
    world_from_cam: Array
    cov_pose: Array
    q_in_cam: Array
    cov_q_in_cam: Array
    points_in_cam: Array
    cov_points: Array
    points_in_world: Array
    cov_points_in_world: Array
    finite: NDArray[np.bool_]

    @classmethod
    def compute(cls, system: System, state: State, world_from_ref: Array, cov_more: Array) -> "Marginals":
        """Marginalise the factored system; the newest camera is the last one of the state, or else the reference.

        `cov_more` (6, 6): added to its pose, and to the points seen from it.
        """
        found = core.window_marginals(state, system, world_from_ref, cov_more, KNOWN_DEPTH_SIGMAS)
        return filled(cls, found, ids=state.ids)

    def at(self, world_from_cam: Array, cov_pose: Array) -> "Marginals":
        """Return the marginals with the newest camera at a pose (4, 4); points keep their positions in it."""
        in_world = se3.transform(world_from_cam, self.points_in_cam)
        return changed(self, world_from_cam=world_from_cam, cov_pose=cov_pose, points_in_world=in_world)

    def ended(self, still_in_map: NDArray[np.int64] = _NO_IDS) -> WorldPoints:
        """Return the metric points that are no longer in the map; ids ascending."""
        rows = ~core.among(self.ids, still_in_map) & self.finite
        return WorldPoints(*columns_at((self.ids, self.points_in_world, self.cov_points_in_world), rows))
