"""Points with covariances and their stereo views, by which a motion between them is judged."""

import numpy as np
from numpy.typing import NDArray

from .. import core
from .gates import chi2_gate
from .robust_rules import RobustRules
from .se3 import Array
from .stereo import StereoProjection
from .view_stages import CorrectedViews

ROBUST = RobustRules()


class PointViews:
    """Points in a reference camera, homogeneous (n, 4), and their views.

    Points (n, 3) m are also accepted. `cov_points` (n, 3, 3) or (n, 4, 4) of the same dimension, None for exact
    points; `z_px` (n, 4) with NaN where the right side is missing, `cov_px` (n, 4, 4). `gate` (n,): the squared
    residual below which the share of good views in the `settings` stays. `shared` (n, 4, j): the effect of errors
    that all views share, for unknown amplitudes of σ = 1.
    """

    def __init__(
        self,
        projection: StereoProjection,
        points: Array,
        cov_points: Array | None,
        z_px: CorrectedViews,
        cov_px: Array,
        settings: RobustRules = ROBUST,
        shared: Array | None = None,
    ) -> None:
        n = len(z_px)
        if points.shape[-1] == 3:
            points, cov_metric = np.concatenate([points, np.ones((n, 1))], axis=1), cov_points
            if cov_metric is not None:
                cov_points = np.zeros((n, 4, 4))
                cov_points[:, :3, :3] = cov_metric
        self.projection, self.points, self.z_px, self.cov_px = projection, points, z_px, cov_px
        self.cov_points = np.empty((0, 4, 4)) if cov_points is None else cov_points
        self.settings = settings
        self.shared = np.zeros((n, 4, 0)) if shared is None else shared
        share = settings.gate_probability
        self.gate = core.gates_of_views(z_px, chi2_gate(2, share), chi2_gate(4, share))

    @property
    def clear_gate(self) -> Array:
        """Squared residuals (n,) beyond which a view clearly contradicts a motion, not just by chance."""
        return self.settings.beyond_gates * self.gate

    def __len__(self) -> int:
        return len(self.gate)

    def select(self, rows: NDArray[np.bool_]) -> "PointViews":
        """Return the points and views of a mask (n,)."""
        cov_points = self.cov_points[rows] if len(self.cov_points) else None
        seen = self.points[rows], cov_points, CorrectedViews(self.z_px[rows]), self.cov_px[rows]
        return PointViews(self.projection, *seen, self.settings, self.shared[rows])

    def with_shared(self, shared: Array) -> "PointViews":
        """Return the same views with further shared errors (n, 4, j), after those that they have."""
        seen, of_all = (self.points, self.cov_points, self.z_px, self.cov_px), [self.shared, shared]
        return PointViews(self.projection, *seen, self.settings, np.concatenate(of_all, axis=2))

    def scaled(self, sizes: Array) -> "PointViews":
        """Return the same views with shared errors that are larger by factors (j,)."""
        seen = self.points, self.cov_points, self.z_px, self.cov_px
        return PointViews(self.projection, *seen, self.settings, self.shared * sizes)

    def linearise(self, cam_from_ref: Array) -> tuple[Array, Array]:
        """Return roots (n, 4, 4) that whiten the residuals, and the whitened Jacobian (n, 4, 6 + j).

        It is for a left perturbation and for the amplitudes of shared errors.

        The noise is that of the view and of the point itself, seen from the camera. A wild motion may bring a distant
        point next to the camera plane: where nothing is predicted, root and Jacobian are zero.
        """
        return core.linearise_views(self, cam_from_ref)

    def squared_residuals(self, cam_from_ref: Array, root: Array, amplitudes: Array | None = None) -> Array:
        """Return squared whitened residuals (n,) under a motion (4, 4), with or without amplitudes (j,).

        They are inf where nothing is predicted or seen.
        """
        if amplitudes is None:
            amplitudes = np.zeros(self.shared.shape[2])
        return core.view_residuals(self, root, amplitudes, cam_from_ref[None])[1][0]
