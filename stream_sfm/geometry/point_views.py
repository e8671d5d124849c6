"""Points with covariances and their stereo views: what a motion between them is judged by."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import se3
from .gates import chi2_gates
from .linear import matvec
from .se3 import Array
from .stereo import MIN_DEPTH, StereoProjection, clamp_depth, whitening_of_views

# A view that a point predicts to no better than this, a hundred images wide, says nothing about the motion; at a
# hundred times more, the noise of the view itself would be lost to rounding in their sum.
_MAX_PREDICTED_STD_PX = 1e5


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
        self.z = np.nan_to_num(z_px)  # a missing side has no weight
        self.cov_px = cov_px
        self.gate_probability = gate_probability
        self.shared = np.zeros((len(z_px), 4, 0)) if shared is None else shared
        self.sides = np.isfinite(z_px).sum(axis=1)  # 4, or 2 without the right view
        self.gate = chi2_gates(self.sides, gate_probability)

    def __len__(self) -> int:
        return len(self.z_px)

    def select(self, rows: NDArray[Any]) -> "PointViews":
        """The given rows (mask or indices)."""
        cov = None if self.cov_points is None else self.cov_points[rows]
        return PointViews(
            self.projection,
            self.points[rows],
            cov,
            self.z_px[rows],
            self.cov_px[rows],
            self.gate_probability,
            self.shared[rows],
        )

    def without_shared(self, amplitudes: Array) -> "PointViews":
        """The views without the errors that they share, which have these amplitudes (j,)."""
        z_px = self.z_px - self.shared @ amplitudes
        return PointViews(self.projection, self.points, self.cov_points, z_px, self.cov_px, self.gate_probability)

    def linearise(self, cam_from_ref: Array) -> tuple[Array, Array]:
        """Return roots (n, 4, 4) that whiten the residuals, and the whitened Jacobian (n, 4, 6 + j).

        It is that of a left perturbation and of the amplitudes of shared errors.

        The noise is that of the view and of the point itself, as seen from here. A wild motion may bring a distant
        point next to the camera plane: where it predicts nothing, root and Jacobian are zero.
        """
        in_cam = clamp_depth(self.points @ cam_from_ref.T)
        j = self.projection.jacobian_homogeneous(in_cam)
        if self.cov_points is not None:
            by_point = (j.reshape(-1, 4) @ cam_from_ref).reshape(j.shape)
            predicted = by_point @ self.cov_points @ np.swapaxes(by_point, -1, -2)
            placed = np.trace(predicted, axis1=-2, axis2=-1) < _MAX_PREDICTED_STD_PX**2
            root = whitening_of_views(self.z_px, self.cov_px + np.where(placed[:, None, None], predicted, 0.0))
            root[~placed] = 0.0
        else:
            root = whitening_of_views(self.z_px, self.cov_px)
        a = root @ j[..., :3]
        by_pose = a * in_cam[:, None, 3:], -a @ se3.skew(in_cam[:, :3])
        return root, np.concatenate([*by_pose, root @ self.shared], axis=2)

    def residuals(self, cam_from_ref: Array, root: Array, amplitudes: Array | None = None) -> tuple[Array, Array]:
        """Return whitened residuals (n, 4) and their squared norms (n,), inf where `_unusable`.

        `amplitudes` (j,) of the shared errors; None: zero.
        """
        in_cam = self.points @ cam_from_ref.T
        unusable = _unusable(in_cam, root)
        expected = self.projection.project_homogeneous(clamp_depth(in_cam))
        if amplitudes is not None:
            expected += self.shared @ amplitudes
        r = matvec(root, self.z - expected)
        return r, np.where(unusable, np.inf, (r * r).sum(1))

    def squared_residuals(self, cams_from_ref: Array, root: Array) -> Array:
        """Squared whitened residuals (m, n) under each of many motions (m, 4, 4), inf where `_unusable`."""
        in_cam = self.points @ np.swapaxes(cams_from_ref, -1, -2)
        unusable = _unusable(in_cam, root)
        r = matvec(root, self.z - self.projection.project_homogeneous(clamp_depth(in_cam)))
        return np.where(unusable, np.inf, (r * r).sum(-1))


def _unusable(in_cam: Array, root: Array) -> NDArray[np.bool_]:
    """Whether points (…, n, 4) are behind the camera, or predicted nothing where `root` (n, 4, 4) was linearised."""
    return np.asarray((in_cam[..., 2] < MIN_DEPTH) | (root[:, 0, 0] == 0))
