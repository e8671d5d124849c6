"""What an error of the baseline does to everything that is reported, eq. (73).

A wrong baseline makes all lengths too large or too small by one factor. No view shows it, so it is no unknown of any
estimate: its σ is added to whatever length is reported.
"""

import numpy as np

from ..geometry.se3 import Array


class ScaleError:
    """Covariances by a relative error of σ `std` of all lengths."""

    def __init__(self, std: float) -> None:
        self._std = std

    def of_lengths(self, vectors_m: Array) -> Array:
        """Covariances (…, 3, 3), m², of vectors (…, 3)."""
        moved = self._std * vectors_m
        return np.asarray(moved[..., :, None] * moved[..., None, :])

    def of_pose(self, poses: Array) -> Array:
        """Covariances (…, 6, 6) of the perturbations on the right of poses (…, 4, 4)."""
        moved = np.zeros((*poses.shape[:-2], 6))
        moved[..., :3] = self._std * (np.swapaxes(poses[..., :3, :3], -1, -2) @ poses[..., :3, 3:])[..., 0]
        return np.asarray(moved[..., :, None] * moved[..., None, :])
