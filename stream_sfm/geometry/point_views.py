"""Points with covariances and their stereo views: what a motion between them is judged by."""

import numpy as np
from numpy.typing import NDArray

from .. import core
from .gates import chi2_gate
from .se3 import Array
from .stereo import StereoProjection


class PointViews:
    """Points (n, 3) m, or (n, 4) homogeneous, in a reference camera, and their views.

    `cov_points` (n, 3, 3) or (n, 4, 4) of the same dimension, None of exact points; `z_px` (n, 4) with NaN where the
    right side is missing, `cov_px` (n, 4, 4). `gate` (n,): the squared residual under which a share `gate_probability`
    of good views stays. `shared` (n, 4, j): what errors that all views share do to them, by unknown amplitudes of
    σ = 1. `of_core`: all of it as the compiled core takes it.
    """

    def __init__(
        self,
        projection: StereoProjection,
        points: Array,
        cov_points: Array | None,
        z_px: Array,
        cov_px: Array,
        gate_probability: float = 0.999,
        shared: Array | None = None,
    ) -> None:
        n = len(z_px)
        if points.shape[-1] == 3:
            points, cov_metric = np.concatenate([points, np.ones((n, 1))], axis=1), cov_points
            if cov_metric is not None:
                cov_points = np.zeros((n, 4, 4))
                cov_points[:, :3, :3] = cov_metric
        self.projection, self._gate_probability = projection, gate_probability
        self.shared = np.zeros((n, 4, 0)) if shared is None else shared
        self.gate = core.gates_of_views(z_px, chi2_gate(2, gate_probability), chi2_gate(4, gate_probability))
        cov_points = np.empty((0, 4, 4)) if cov_points is None else cov_points
        self.of_core = projection.pinholes, points, cov_points, z_px, cov_px, self.shared, self.gate

    def __len__(self) -> int:
        return len(self.gate)

    @property
    def points(self) -> tuple[Array, Array]:
        """The points (n, 4), homogeneous, and their covariances (n, 4, 4), none of exact ones."""
        return self.of_core[1], self.of_core[2]

    def select(self, rows: NDArray[np.bool_]) -> "PointViews":
        """Return the points and views of a mask (n,)."""
        _, points, cov_points, z_px, cov_px, shared, _ = self.of_core
        cov = cov_points[rows] if len(cov_points) else None
        rest = z_px[rows], cov_px[rows], self._gate_probability, shared[rows]
        return PointViews(self.projection, points[rows], cov, *rest)

    def by_left(self) -> "PointViews":
        """Return the same points with the left sides of their views alone."""
        _, points, cov_points, z_px, cov_px, shared, _ = self.of_core
        left_px = np.where([True, True, False, False], z_px, np.nan)
        return PointViews(self.projection, points, cov_points, left_px, cov_px, self._gate_probability, shared)

    def linearise(self, cam_from_ref: Array) -> tuple[Array, Array]:
        """Return roots (n, 4, 4) that whiten the residuals, and the whitened Jacobian (n, 4, 6 + j).

        It is that of a left perturbation and of the amplitudes of shared errors.

        The noise is that of the view and of the point itself, as seen from here. A wild motion may bring a distant
        point next to the camera plane: where it predicts nothing, root and Jacobian are zero.
        """
        return core.linearise_views(self.of_core, cam_from_ref)

    def squared_residuals(self, cam_from_ref: Array, root: Array) -> Array:
        """Squared whitened residuals (n,) under a motion (4, 4) without shared errors.

        inf where nothing is predicted or seen.
        """
        return core.view_residuals(self.of_core, root, np.zeros(self.shared.shape[2]), cam_from_ref[None])[1][0]
