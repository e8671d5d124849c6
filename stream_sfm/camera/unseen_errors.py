"""What errors of the calibration that no view shows do to everything that is reported, eqs. (73) and (73a).

A wrong baseline makes all lengths too large or too small by one factor. Principal points that are off by δ in both
cameras turn the camera's axes by δ/f: everything is as before, in other axes. Neither is an unknown of any estimate:
their σ are added to whatever is reported.
"""

import numpy as np

from ..geometry import se3
from ..geometry.se3 import Array


class UnseenErrors:
    """Covariances by a relative error of all lengths, σ `std_scale`, and by axes that are off, σ `std_axes_rad`.

    The axes err about x and y.
    """

    def __init__(self, std_scale: float, std_axes_rad: float) -> None:
        self._std_scale, self._std_axes_rad = std_scale, std_axes_rad

    def of_points(self, points_m: Array) -> Array:
        """Covariances (…, 3, 3), m², of points (…, 3) in the camera, or in the world, which is the first camera."""
        moved = np.concatenate(
            [self._std_scale * points_m[..., None], self._std_axes_rad * -se3.skew(points_m)[..., :2]], axis=-1
        )
        return moved @ np.swapaxes(moved, -1, -2)

    def of_pose(self, poses: Array) -> Array:
        """Covariances (…, 6, 6) of the perturbations on the right of poses (…, 4, 4)."""
        moved = self.by_pose(poses)
        return moved @ np.swapaxes(moved, -1, -2)

    def by_pose(self, poses: Array) -> Array:
        """Perturbations (…, 6, 3) on the right of poses T (…, 4, 4), per σ of lengths and of axes about x and y.

        Axes that are turned by C make C T C⁻¹ of T, which is T Exp((Ad(T⁻¹) − I) c).
        """
        moved = np.zeros((*poses.shape[:-2], 6, 3))
        along = np.swapaxes(poses[..., :3, :3], -1, -2) @ poses[..., :3, 3:]
        moved[..., :3, :1] = self._std_scale * along
        moved[..., 1:] = self._std_axes_rad * (se3.adjoint(se3.inverse(poses)) - np.eye(6))[..., 3:5]
        return moved
