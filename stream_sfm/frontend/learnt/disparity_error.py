"""The estimated disparity error, and its effect on views of points that were triangulated with it.

A wrong disparity puts near and far points at wrong depths, so that they seem to move differently when the camera moves.
A resection that ignores this sees two rigid motions.
"""

import numpy as np

from ... import core
from ...geometry import Array
from ...geometry.stereo import StereoProjection
from ...record import record
from ...rig_model.estimate import RigEstimate
from ...rig_model.model import RigModel
from ...rig_model.terms import DISPARITY


@record
class DisparityError:
    """Terms of the disparity error: their `mean` (6,) px, and a `root` (6, 6) of their covariance."""

    projection: StereoProjection
    mean: Array
    root: Array

    @classmethod
    def of(cls, rig: RigModel, found: RigEstimate | None = None, step_px: float = 0.0) -> "DisparityError":
        """Return the prior, or the error that an estimator has `found`, widened by a step of σ `step_px`."""
        mean, root = rig.known[DISPARITY], rig.root[DISPARITY, DISPARITY]
        if found is not None:
            mean, cov = rig.disparity(found)
            root = np.asarray(np.linalg.cholesky(cov + step_px**2 * np.eye(len(mean))), np.float64)
        return cls(rig.projection, mean, root)

    def effects(self, points: Array, cam_from_previous: Array, z_px: Array) -> tuple[Array, Array]:
        """Return the effect (n, 4) px of the mean on views (n, 4) of the previous camera's points (n, 4).

        Also returns the effects (n, 4, 6) px of unknown errors of σ = 1. The error of a point's own disparity is in its
        depth.
        """
        by_term = core.disparity_effects(self.projection, points, cam_from_previous, z_px)
        return by_term @ self.mean, by_term @ self.root
