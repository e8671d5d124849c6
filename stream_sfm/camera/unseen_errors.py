"""From rectified axes, in which everything is estimated, to those of the physical left camera, in which it is reported.

With what errors of the calibration that no view shows do to it, eqs. (73) and (73a). A wrong baseline makes all
lengths too large or too small by one factor. Principal points that are off by δ in both cameras turn the camera's axes
by δ/f: everything is as before, in other axes. Neither is an unknown of any estimate: their σ are added to whatever is
reported.
"""

import numpy as np

from .. import core
from ..geometry import Array


class PhysicalAxes:
    """Turns rectified axes, of the camera and of the world, into those of the physical left camera.

    The world is the first left camera: T_cam = C⁻¹ T_rect C, and right perturbations turn with C⁻¹, eq. (7). Adds a
    relative error of all lengths, σ `std_scale`, and one of the axes about x and y, σ `std_axes_rad`.
    """

    def __init__(self, rect_from_cam: Array, std_scale: float = 0.0, std_axes_rad: float = 0.0) -> None:
        self.rotation = np.ascontiguousarray(rect_from_cam.T)
        self.std_scale, self.std_axes_rad = std_scale, std_axes_rad

    def poses(self, poses: Array) -> Array:
        """Turn poses (n, 4, 4)."""
        return self.motions(poses, np.zeros((len(poses), 6, 6)))[0]

    def motions(self, poses: Array, cov: Array, by_terms: Array | None = None) -> tuple[Array, Array, Array]:
        """Turn poses (n, 4, 4), with covariances (n, 6, 6) of the perturbations on their right.

        Also returns the perturbations (n, 6, 3 + t) per σ of lengths, of axes about x and y, and of the errors of
        `by_terms` (n, 6, t).
        """
        by_terms = np.empty((len(poses), 6, 0)) if by_terms is None else by_terms
        return core.reported_motions(self, poses, cov, by_terms)

    def points(self, points_m: Array, cov: Array, std_shared: Array, frame_from_cam: Array) -> tuple[Array, Array]:
        """Turn points (n, 3) with covariances (n, 3, 3), m², that were seen from a camera (4, 4) in their frame.

        All views of a point share an error of its inverse depth, σ `std_shared` (n,), 1/m, eq. (18).
        """
        return core.reported_points(self, points_m, cov, std_shared, frame_from_cam)
