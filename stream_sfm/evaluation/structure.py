"""The errors of the local structure (CC) against measured or rendered depth images.

Each estimated point is projected into the physical left image. Around that pixel a plane is fitted to the true
inverse depth over 5×5 pixels (the image of a planar patch has exactly affine inverse depth); where the fit is off by
more than 1 % anywhere, a depth edge is near and the point is left out. The error is the estimated depth minus the
true depth along the same viewing ray, in metres. A depth image reveals errors along the viewing ray in full, but
hardly any sideways error on a surface that faces the camera.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..camera.lens import project_into_image
from ..camera.models import Camera
from ..geometry.se3 import Array
from ..geometry.stereo import MIN_DEPTH
from ..types import FrameEstimate

_HALF = 2  # the patch is 5×5
_MAX_MISFIT = 0.01  # of the inverse depth, relative: a larger one marks a depth edge
_OFFSETS = np.arange(-_HALF, _HALF + 1)
_DESIGN = np.stack(
    [np.ones(25), np.tile(_OFFSETS, 5).astype(float), np.repeat(_OFFSETS, 5).astype(float)], axis=1
)  # columns: 1, du, dv
_FIT = np.linalg.pinv(_DESIGN)
_BINS = np.geomspace(1e-6, 1e3, 2100)  # 1 % apart: of metres or of σ, gives medians without keeping the errors
_MANY_SIGMAS = 3.0  # 0.27 % of Gaussian errors are larger


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class StructureErrors:
    """Depth errors (m,) of the points of one frame, and their estimated standard deviations (m,); metres."""

    errors_m: Array
    sigmas_m: Array


def structure_errors(
    camera: Camera, points_in_cam: Array, cov_points: Array, true_depth_m: NDArray[np.floating]
) -> StructureErrors:
    """Compare points (n, 3) with covariances (n, 3, 3) with a depth image (h, w), NaN where unknown.

    Depth is measured along the optical axis. Points outside the image, at depth edges, or without known depth around
    them are left out.
    """
    front = points_in_cam[:, 2] > MIN_DEPTH
    points, cov = points_in_cam[front], cov_points[front]
    uv = project_into_image(camera, points)
    h, w = true_depth_m.shape
    margin = np.array([_HALF, _HALF])
    with np.errstate(invalid="ignore"):
        inside = ((uv >= margin) & (uv <= np.array([w - 1, h - 1]) - margin)).all(axis=1)
    points, cov, uv = points[inside], cov[inside], uv[inside]

    centre = np.rint(uv).astype(int)
    rows = centre[:, 1, None, None] + _OFFSETS[:, None]
    cols = centre[:, 0, None, None] + _OFFSETS[None, :]
    with np.errstate(divide="ignore"):
        inverse = 1 / true_depth_m[rows, cols].reshape(-1, 25).astype(float)
    plane = inverse @ _FIT.T  # (m, 3): inverse depth at the centre, and its slopes per pixel
    misfit = abs(inverse - plane @ _DESIGN.T).max(axis=1)
    with np.errstate(invalid="ignore"):
        smooth = np.isfinite(plane).all(axis=1) & (misfit < _MAX_MISFIT * plane[:, 0])
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
    return StructureErrors(depth - true, np.sqrt(np.maximum(variance, 0)))


class StructureComparison:
    """Sums the depth errors of a run, frame by frame; neither depth images nor errors are kept."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self.frames = 0
        self.points = 0
        self._squares = 0.0
        self._normalised = 0.0
        self._with_sigma = 0
        self._beyond = 0
        self._histogram_m = np.zeros(len(_BINS) + 1, dtype=np.int64)
        self._histogram_sigmas = np.zeros(len(_BINS) + 1, dtype=np.int64)

    def add(self, estimate: FrameEstimate, true_depth_m: NDArray[np.floating] | None) -> StructureErrors | None:
        """Compare one frame with its depth image (h, w); None, and nothing is added, where they cannot be compared.

        That is where there is no depth image, where it has another size than the camera's, or without any point.
        """
        depth = true_depth_m
        size = (self._camera.height, self._camera.width)
        if depth is None or depth.shape != size or len(estimate.points_in_cam) == 0:
            return None
        found = structure_errors(self._camera, estimate.points_in_cam, estimate.cov_points, depth)
        known = found.sigmas_m > 0
        self.frames += 1
        self.points += len(found.errors_m)
        self._squares += float((found.errors_m**2).sum())
        in_sigmas = abs(found.errors_m[known] / found.sigmas_m[known])
        self._normalised += float((in_sigmas**2).sum())
        self._with_sigma += int(known.sum())
        self._beyond += int((in_sigmas > _MANY_SIGMAS).sum())
        np.add.at(self._histogram_m, np.searchsorted(_BINS, abs(found.errors_m)), 1)
        np.add.at(self._histogram_sigmas, np.searchsorted(_BINS, in_sigmas), 1)
        return found

    @property
    def rms_m(self) -> float:
        """RMS depth error of all points away from depth edges, in metres; NaN where nothing was compared."""
        return float(np.sqrt(self._squares / self.points)) if self.points else float("nan")

    @property
    def median_m(self) -> float:
        """Median absolute depth error in metres, rounded to 1 %; NaN where nothing was compared."""
        return _median(self._histogram_m)

    @property
    def rms_over_sigma(self) -> float:
        """RMS of error over estimated σ: 1 is consistent, more is overconfident; NaN where nothing was compared.

        One wrong point among thousands can decide it; `median_over_sigma` and `beyond_3_sigma_percent` say whether.
        """
        return float(np.sqrt(self._normalised / self._with_sigma)) if self._with_sigma else float("nan")

    @property
    def median_over_sigma(self) -> float:
        """Median of |error| over estimated σ, rounded to 1 %: 0.67 is consistent; NaN where nothing was compared."""
        return _median(self._histogram_sigmas)

    @property
    def beyond_3_sigma_percent(self) -> float:
        """Points whose error is more than 3 estimated σ: 0.27 % is consistent; NaN where nothing was compared."""
        return 100 * self._beyond / self._with_sigma if self._with_sigma else float("nan")


def _median(histogram: NDArray[np.int64]) -> float:
    """Median of values counted in `_BINS`, NaN where there are none."""
    count = int(histogram.sum())
    if not count:
        return float("nan")
    half = int(np.searchsorted(np.cumsum(histogram), count / 2))
    return float(_BINS[min(half, len(_BINS) - 1)])
