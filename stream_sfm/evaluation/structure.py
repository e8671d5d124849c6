"""Errors of the local structure (CC) against measured or rendered depth images.

Each estimated point is projected into the physical left image. Around that pixel a plane is fitted to the true
inverse depth over 5×5 pixels (the inverse depth of a planar patch is exactly affine in the image). If the fit
deviates by more than 1 % anywhere, a depth edge is near and the point is left out. The error is the estimated depth
minus the true depth along the same viewing ray, in metres. A depth image shows errors along the viewing ray in
full, but hardly any sideways error on a surface that faces the camera.
"""

from array import array

import numpy as np
from numpy.typing import NDArray

from ..camera.lens import project_into_image
from ..camera.models import Camera
from ..geometry import Array
from ..geometry.medians import median
from ..geometry.stereo import MIN_DEPTH
from ..record import record
from ..types import FrameEstimate
from .global_structure import TestPoints
from .settings import SETTINGS

_HALF = 2  # the patch is 5×5
_OFFSETS = np.arange(-_HALF, _HALF + 1)
_DESIGN = np.stack(
    [np.ones(25), np.tile(_OFFSETS, 5).astype(float), np.repeat(_OFFSETS, 5).astype(float)], axis=1
)  # columns: 1, du, dv
_FIT = np.linalg.pinv(_DESIGN)
STRUCTURE_FIGURES = (
    "local_structure_rms_m", "local_structure_median_m", "local_structure_error_over_sigma",
    "local_structure_error_over_sigma_median", "local_structure_beyond_3_sigma_percent",
)  # fmt: skip


@record
class StructureErrors:
    """Depth errors (m,) of the points of one frame, and their estimated standard deviations (m,); metres.

    They are of the points in `rows` (m,), whose rays meet the surface at `true_in_cam` (m, 3).
    """

    errors_m: Array
    sigmas_m: Array
    rows: NDArray[np.intp]
    true_in_cam: Array


def structure_errors(
    camera: Camera, points_in_cam: Array, cov_points: Array, true_depth_m: NDArray[np.floating]
) -> StructureErrors:
    """Compare points (n, 3) and their covariances (n, 3, 3) with a depth image (h, w), NaN where unknown.

    Depth is along the optical axis. Points outside the image, at depth edges or without depth around them are left out.
    """
    front = points_in_cam[:, 2] > MIN_DEPTH
    points, cov = points_in_cam[front], cov_points[front]
    uv = project_into_image(camera, points)
    h, w = true_depth_m.shape
    margin = np.array([_HALF, _HALF])
    with np.errstate(invalid="ignore"):
        inside = ((uv >= margin) & (uv <= np.array([w - 1, h - 1]) - margin)).all(axis=1)
    points, cov, uv = points[inside], cov[inside], uv[inside]
    among = np.flatnonzero(front)[inside]

    centre = np.rint(uv).astype(int)
    rows = centre[:, 1, None, None] + _OFFSETS[:, None]
    cols = centre[:, 0, None, None] + _OFFSETS[None, :]
    with np.errstate(divide="ignore"):
        inverse = 1 / true_depth_m[rows, cols].reshape(-1, 25).astype(float)
    plane = inverse @ _FIT.T  # (m, 3): inverse depth at the centre, and its slopes per pixel
    misfit = abs(inverse - plane @ _DESIGN.T).max(axis=1)
    with np.errstate(invalid="ignore"):
        smooth = np.isfinite(plane).all(axis=1) & (misfit < SETTINGS.max_misfit * plane[:, 0])
    points, cov, plane = points[smooth], cov[smooth], plane[smooth]
    offset = (uv - centre)[smooth]
    true = 1 / (plane[:, 0] + (plane[:, 1:] * offset).sum(axis=1))

    # gradient of (depth of the point − depth of the surface on its ray) with respect to the point, neglecting how
    # lens distortion changes within the patch
    x, y, depth = points.T
    su = plane[:, 1] * camera.K[0, 0] * true**2 / depth
    sv = plane[:, 2] * camera.K[1, 1] * true**2 / depth
    gradient = np.stack([su, sv, 1 - (su * x + sv * y) / depth], axis=1)
    variance = np.einsum("ni,nij,nj->n", gradient, cov, gradient)
    stds = np.sqrt(np.maximum(variance, 0))
    return StructureErrors(depth - true, stds, among[smooth], points * (true / depth)[:, None])


class StructureComparison:
    """Collects the depth errors of a run and their σ, eight bytes per point, but no depth images; and `test_points`."""

    def __init__(self, camera: Camera) -> None:
        self.camera, self.test_points = camera, TestPoints()
        self._errors_m, self._sigmas_m = array("f"), array("f")

    def add(self, estimate: FrameEstimate, true_depth_m: NDArray[np.floating] | None) -> StructureErrors | None:
        """Compare one frame with its depth image (h, w); None, and nothing is added, if they cannot be compared.

        That is the case without a depth image, with one of another size than the images, or without any point.
        """
        size = (self.camera.height, self.camera.width)
        if true_depth_m is None or true_depth_m.shape != size or len(estimate.points_in_cam) == 0:
            self.test_points.add(estimate, np.zeros(0, np.intp), np.zeros((0, 3)))
            return None
        found = structure_errors(self.camera, estimate.points_in_cam, estimate.cov_points, true_depth_m)
        self._errors_m.extend(found.errors_m.tolist())
        self._sigmas_m.extend(found.sigmas_m.tolist())
        self.test_points.add(estimate, found.rows, found.true_in_cam)
        return found

    def figures(self) -> dict[str, float]:
        """Return the figures of all points away from depth edges, NaN where nothing was compared.

        RMS and median depth errors in metres; RMS and median of error over estimated σ (consistent: 1 and 0.67); and
        the percentage of points with errors of more than 3 σ (consistent: 0.27). One wrong point among thousands
        can dominate an RMS; the median and the percentage show whether it does.
        """
        errors_m, sigmas_m = (np.abs(np.array(x, float)) for x in (self._errors_m, self._sigmas_m))
        ratios = errors_m[sigmas_m > 0] / sigmas_m[sigmas_m > 0]
        if not len(ratios):
            return dict.fromkeys(STRUCTURE_FIGURES, np.nan)
        of_both = [f(x) for x in (errors_m, ratios) for f in (lambda x: np.sqrt(np.mean(x**2)), median)]
        beyond = 100 * np.mean(ratios > 3)
        return dict(zip(STRUCTURE_FIGURES, map(float, (*of_both, beyond)), strict=True))
