"""What is known of the disparity's error, and what it does to views of points that were measured with it.

A wrong disparity puts near and far points at wrong depths, and where the camera moves they seem to move differently. A
resection that knows nothing of that sees two rigid motions.
"""

import numpy as np

from .. import core
from ..geometry import Array
from ..geometry.stereo import StereoProjection
from ..record import record
from ..rig_model.estimate import RigEstimate
from ..rig_model.model import RigModel
from ..rig_model.terms import DISPARITY


@record
class DisparityError:
    """Terms of the disparity's error: `mean` (6,) px, and a `root` (6, 6) of their covariance."""

    projection: StereoProjection
    mean: Array
    root: Array

    @classmethod
    def of(cls, rig: RigModel, found: RigEstimate | None = None, step_px: float = 0.0) -> "DisparityError":
        """Return what is known beforehand, or of what an estimator has `found`, for a step of σ `step_px`."""
        mean, root = rig.known[DISPARITY], rig.root[DISPARITY, DISPARITY]
        if found is not None:
            mean, cov = rig.disparity(found)
            root = np.asarray(np.linalg.cholesky(cov + step_px**2 * np.eye(len(mean))), np.float64)
        return cls(rig.projection, mean, root)

    def effects(self, points: Array, cam_from_previous: Array, z_px: Array) -> tuple[Array, Array]:
        """Return what the mean does to views (n, 4) of the previous camera's points (n, 4), and errors of σ = 1.

        (n, 4) and (n, 4, 6) px. What a point's own disparity has wrong is in its depth.
        """
        by_term = core.disparity_effects(self.projection, points, cam_from_previous, z_px)
        return by_term @ self.mean, by_term @ self.root
