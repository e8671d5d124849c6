"""Points with covariances and their stereo views: what a motion between them is judged by."""

import numpy as np

from .. import core
from .gates import chi2_gate
from .se3 import Array
from .stereo import Pinholes, StereoProjection


class PointViews:
    """Homogeneous points (n, 4) in a reference camera with covariances (n, 4, 4) (None: exact), and their views.

    `z_px` (n, 4) with NaN where the right side is missing, `cov_px` (n, 4, 4). Of each view, `sides` (n,) is the
    number of measured coordinates and `gate` (n,) the squared residual under which a share `gate_probability` of good
    ones stays. `shared` (n, 4, j): what errors that all views share do to them, by unknown amplitudes of σ = 1.
    """

    def __init__(
        self,
        projection: StereoProjection,
        points: Array,
        cov_points: Array | None,
        z_px: Array,
        cov_px: Array,
        gate_probability: float,
        shared: Array | None = None,
    ) -> None:
        self.projection = projection
        self.points = points
        self.cov_points = cov_points
        self.z_px = z_px
        self.cov_px = cov_px
        self.gate_probability = gate_probability
        self.shared = np.zeros((len(z_px), 4, 0)) if shared is None else shared
        self.gate = core.gates_of_views(z_px, chi2_gate(2, gate_probability), chi2_gate(4, gate_probability))

    def __len__(self) -> int:
        return len(self.z_px)

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

    @property
    def of_core(self) -> tuple[Pinholes, Array, Array, Array, Array, Array, Array]:
        """The arrays that the compiled core takes."""
        cov = np.empty((0, 4, 4)) if self.cov_points is None else self.cov_points
        return self.projection.pinholes, self.points, cov, self.z_px, self.cov_px, self.shared, self.gate
