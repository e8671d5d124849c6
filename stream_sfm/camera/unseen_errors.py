"""What errors of the calibration that no view shows do to everything that is reported, eqs. (73) and (73a).

A wrong baseline makes all lengths too large or too small by one factor. Principal points that are off by δ in both
cameras turn the camera's axes by δ/f: everything is as before, in other axes. Neither is an unknown of any estimate:
their σ are added to whatever is reported.
"""

import numpy as np

from .. import core
from ..geometry.se3 import Array


class UnseenErrors:
    """Covariances by a relative error of all lengths, σ `std_scale`, and by axes that are off, σ `std_axes_rad`.

    The axes err about x and y.
    """

    def __init__(self, std_scale: float, std_axes_rad: float) -> None:
        self._std_scale, self._std_axes_rad = std_scale, std_axes_rad

    def in_points(self, cov: Array, points_m: Array, shared_m: Array, axes: Array) -> Array:
        """Covariances (n, 3, 3), m², in other axes (3, 3), of points (n, 3) in the camera, or in the world.

        The world is the first camera. `cov` (n, 3, 3): what they have by themselves; `shared_m` (n, 3): one σ of an
        error that all views of a point share.
        """
        return core.reported_covariances(cov, points_m, shared_m, self._std_scale, self._std_axes_rad, axes)

    def of_pose(self, poses: Array) -> Array:
        """Covariances (…, 6, 6) of the perturbations on the right of poses (…, 4, 4)."""
        moved = self.by_pose(poses)
        return moved @ np.swapaxes(moved, -1, -2)

    def by_pose(self, poses: Array) -> Array:
        """Perturbations (…, 6, 3) on the right of poses T (…, 4, 4), per σ of lengths and of axes about x and y.

        Axes that are turned by C make C T C⁻¹ of T, which is T Exp((Ad(T⁻¹) − I) c).
        """
        moved = core.unseen_by_pose(poses.reshape(-1, 4, 4), self._std_scale, self._std_axes_rad)
        return moved.reshape(*poses.shape[:-2], 6, 3)
