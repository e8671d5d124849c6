"""Robust resection: the motion of a stereo camera from points with covariances and their stereo views.

Every estimator starts a frame from it, and the front-end takes its outlier test from it. Cauchy weights come first,
wide and then narrow; then a χ² gate and plain least squares over the accepted views, so that the covariance is that of
Gaussian noise. Where few views are accepted, the best of many three-point alignments is tried as another start.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import se3
from .gates import chi2_gates
from .linear import matvec, scaled_inverse
from .se3 import Array
from .stereo import MIN_DEPTH, StereoProjection, clamp_depth, whitening_of_views

MIN_VIEWS = 6  # twelve coordinates at least, twice the unknowns, even where every view lacks its right side
_MEDIAN_CHI2_4 = 3.36  # closed form: the median of χ² with four degrees of freedom
# Cauchy weights, in squared standard deviations of a view.
_CAUCHY_WIDTH = 2.4**2  # literature: 95 % efficiency on Gaussian noise
_CAUCHY_WIDTH_FIRST = (
    6.0  # a little wider while the motion is still moving fast: fewer good views are let go of early
)
_WIDE_STEPS = 3
_MAX_ROBUST_STEPS = 9
_MAX_FINAL_STEPS = 4
_RELINEARISE_EVERY = 3  # steps: between them the pose moves too little to change the Jacobian much
# Squared length of a step in standard deviations of the motion, below which iterating stops.
_ROBUST_CONVERGED = 0.3  # half a standard deviation; the final least squares does the rest
_FINAL_CONVERGED = 1e-2  # a tenth of a standard deviation
_SPREAD_SETTLED = 2.0  # residuals this close to their expected size: the first step may already be the last
_MAX_ROTATION_STEP_RAD = (
    0.3  # a linearised rotation is off by a few per cent there; longer steps keep their direction
)
_MIN_SINGULAR_VALUE = 1e-10  # of the scaled information, relative to the largest: below it no step is taken
# Three-point hypotheses.
_RETRY_BELOW = 0.6  # accepted share: a good start accepts more even at 30 % outliers, and a retry costs a few ms
_HYPOTHESES = 96  # closed form: at 50 % outliers, P(no clean triple) = (1 - 1/8)**96 < 3e-6
_TRIPLE_VARIANCE_PX2 = (
    4.0  # 2 px added to each view's σ when triples are ranked: three points fix a pose only roughly
)
_TRUNCATED_AT = 9.0  # squared residual, 3 σ: what an outlier counts in the ranking
_AT_INFINITY = 1e-6  # fourth coordinate, 1/m: a kilometre and more has no metric position to align


@dataclass(frozen=True, slots=True)
class Resection:
    """The motion that brings points onto their views.

    `cam_from_ref` (4, 4); `cov_pose` (6, 6): of ref_from_cam, right perturbation; `accepted` (n,) bool; `chi2` and
    `dof` of the accepted views; `spread`: median squared residual of all views over its expected value, at least 1;
    `ok`: enough accepted views, and they determine the motion.
    """

    cam_from_ref: Array
    cov_pose: Array
    accepted: NDArray[np.bool_]
    chi2: float
    dof: int
    spread: float
    ok: bool


def homogeneous(points: Array, cov_points: Array | None) -> tuple[Array, Array | None]:
    """Return points (n, 3) and covariances (n, 3, 3) as homogeneous ones (n, 4), (n, 4, 4)."""
    n = len(points)
    cov = None
    if cov_points is not None:
        cov = np.zeros((n, 4, 4))
        cov[:, :3, :3] = cov_points
    return np.concatenate([points, np.ones((n, 1))], axis=1), cov


def resect(
    projection: StereoProjection,
    points_in_ref: Array,
    cov_points: Array | None,
    z_px: Array,
    cov_px: Array,
    cam_from_ref_start: Array,
    gate_probability: float = 0.999,
) -> Resection:
    """Find the motion `cam_from_ref` that brings points onto their views, eqs. (20)–(23).

    `points_in_ref` (n, 3) metres or (n, 4) homogeneous, `cov_points` of the same dimension (None: exact),
    `z_px` (n, 4) with NaN where the right side is missing, `cov_px` (n, 4, 4), start (4, 4).
    """
    if len(z_px) < MIN_VIEWS:
        unknown = np.full((6, 6), np.inf)
        return Resection(cam_from_ref_start, unknown, np.zeros(len(z_px), bool), 0.0, 0, 1.0, False)
    if points_in_ref.shape[-1] == 3:
        points_in_ref, cov_points = homogeneous(points_in_ref, cov_points)
    problem = _Problem(projection, points_in_ref, cov_points, z_px, cov_px, gate_probability)
    result = problem.solve(cam_from_ref_start)
    if result.accepted.mean() < _RETRY_BELOW:
        other = problem.solve(problem.best_hypothesis(cam_from_ref_start))
        if other.accepted.sum() > result.accepted.sum():
            result = other
    return result


class _Problem:
    def __init__(
        self,
        projection: StereoProjection,
        points: Array,
        cov_points: Array | None,
        z_px: Array,
        cov_px: Array,
        gate_probability: float,
    ) -> None:
        self.projection = projection
        self.points = points
        self.cov_points = cov_points
        self.z_px = z_px
        self.z = np.nan_to_num(z_px)  # a missing side has no weight
        self.cov_px = cov_px
        self.sides = np.isfinite(z_px).sum(axis=1)  # measured coordinates: 4, or 2 without the right view
        self.gate = chi2_gates(self.sides, gate_probability)

    def solve(self, cam_from_ref: Array) -> Resection:
        """Anneal Cauchy weights, gate, and finish with plain least squares over the accepted views."""
        return self._least_squares(*self._robust_fit(cam_from_ref))

    def _robust_fit(self, cam_from_ref: Array) -> tuple[Array, Array, Array]:
        """Gauss-Newton with Cauchy weights relative to the spread of the residuals, eq. (22).

        Returns the motion, and roots and Jacobian as `_linearise` has them.
        """
        root, j = self._linearise(cam_from_ref)
        r, s2 = self._residuals(cam_from_ref, root)
        for k in range(_MAX_ROBUST_STEPS):
            spread = _spread(s2)
            width = spread * (_CAUCHY_WIDTH_FIRST if k < _WIDE_STEPS else _CAUCHY_WIDTH)
            cam_from_ref, moved, _ = _step(cam_from_ref, j, r, 1 / (1 + s2 / width))
            if moved < _ROBUST_CONVERGED and (k >= _WIDE_STEPS - 1 or spread < _SPREAD_SETTLED):
                break
            if (k + 1) % _RELINEARISE_EVERY == 0:
                root, j = self._linearise(cam_from_ref)
            r, s2 = self._residuals(cam_from_ref, root)
        if k > 0:  # a start that needed no second step was good enough to be linearised at
            root, j = self._linearise(cam_from_ref)
        return cam_from_ref, root, j

    def _least_squares(self, cam_from_ref: Array, root: Array, j: Array) -> Resection:
        """Gauss-Newton over the views that pass the gate, eq. (23), which is taken anew after each step."""
        r, s2 = self._residuals(cam_from_ref, root)
        accepted = s2 < self.gate
        for _ in range(_MAX_FINAL_STEPS):
            cam_from_ref, moved, information = _step(cam_from_ref, j, r, accepted.astype(float))
            r, s2 = self._residuals(cam_from_ref, root)
            before, accepted = accepted, s2 < self.gate
            if moved < _FINAL_CONVERGED and (before == accepted).all():
                break
        cov = scaled_inverse(information)
        return Resection(
            cam_from_ref=se3.orthonormalise(cam_from_ref),
            cov_pose=np.full((6, 6), np.inf) if cov is None else cov,
            accepted=accepted,
            chi2=float(s2[accepted].sum()),
            dof=int(self.sides[accepted].sum()) - 6,
            spread=_spread(s2),
            ok=cov is not None and bool(accepted.sum() >= MIN_VIEWS),
        )

    def _linearise(self, cam_from_ref: Array) -> tuple[Array, Array]:
        """Return roots (n, 4, 4) that whiten the residuals, and the whitened Jacobian (n, 4, 6) of a left perturbation.

        The noise is that of the view and of the point itself, as seen from here.
        """
        in_cam = clamp_depth(self.points @ cam_from_ref.T)
        j = self.projection.jacobian_homogeneous(in_cam)
        cov = self.cov_px
        if self.cov_points is not None:
            by_point = j @ cam_from_ref
            cov = cov + by_point @ self.cov_points @ np.swapaxes(by_point, -1, -2)
        root = whitening_of_views(self.z_px, cov)
        a = root @ j[..., :3]
        return root, np.concatenate([a * in_cam[:, None, 3:], -a @ se3.skew(in_cam[:, :3])], axis=2)

    def _residuals(self, cam_from_ref: Array, root: Array) -> tuple[Array, Array]:
        """Return whitened residuals (n, 4) and their squared norms (n,), which are inf behind the camera."""
        in_cam = self.points @ cam_from_ref.T
        behind = in_cam[:, 2] < MIN_DEPTH
        r = matvec(root, self.z - self.projection.project_homogeneous(clamp_depth(in_cam)))
        return r, np.where(behind, np.inf, (r * r).sum(1))

    def best_hypothesis(self, start: Array) -> Array:
        """Return the best by truncated cost of `start` and of many alignments of three triangulated views each."""
        depth = self.projection.depth_m(self.z_px)
        metric = (self.sides == 4) & (depth > 0) & np.isfinite(depth) & (self.points[:, 3] > _AT_INFINITY)
        usable = np.flatnonzero(metric)
        if len(usable) < 3:
            return start
        rng = np.random.default_rng(len(usable))  # fixed by the data: the same frame gives the same answer
        triples = usable[rng.random((_HYPOTHESES, len(usable))).argpartition(2, axis=1)[:, :3]]
        source = self.points[triples, :3] / self.points[triples, 3:]
        candidates = np.concatenate([start[None], _align(source, self.projection.triangulate(self.z_px[triples]))])
        root = whitening_of_views(self.z_px, self.cov_px + _TRIPLE_VARIANCE_PX2 * np.eye(4))
        costs = [np.minimum(self._residuals(c, root)[1], _TRUNCATED_AT).sum() for c in candidates]
        return np.asarray(candidates[int(np.argmin(costs))])


def _step(cam_from_ref: Array, j: Array, r: Array, weight: Array) -> tuple[Array, float, Array]:
    """Take one weighted Gauss-Newton step: the new pose, the squared length in deviations, the information (6, 6)."""
    weighted = (j * weight[:, None, None]).reshape(-1, 6).T
    h, g = weighted @ j.reshape(-1, 6), weighted @ r.ravel()
    scale = 1 / np.sqrt(np.maximum(np.diag(h), 1e-12))  # an unseen direction has a zero there
    delta = scale * np.linalg.lstsq(h * np.outer(scale, scale), g * scale, rcond=_MIN_SINGULAR_VALUE)[0]
    angle = np.linalg.norm(delta[3:])
    if angle > _MAX_ROTATION_STEP_RAD:
        delta *= _MAX_ROTATION_STEP_RAD / angle
    return se3.exp(delta) @ cam_from_ref, float(delta @ h @ delta), h


def _align(source: Array, target: Array) -> Array:
    """Return rigid motions (k, 4, 4) that bring triples (k, 3, 3) of points onto others (Umeyama 1991)."""
    ms, mt = source.mean(1, keepdims=True), target.mean(1, keepdims=True)
    u, _, vt = np.linalg.svd(np.swapaxes(target - mt, 1, 2) @ (source - ms))
    u[:, :, 2] *= (np.linalg.det(u) * np.linalg.det(vt))[:, None]
    rotation = u @ vt
    return se3.from_rotation_translation(rotation, (mt - ms @ np.swapaxes(rotation, 1, 2))[:, 0])


def _spread(s2: Array) -> float:
    """Return the median of squared residuals over its expected value, at least 1."""
    finite = np.isfinite(s2)
    return max(1.0, float(np.median(s2[finite])) / _MEDIAN_CHI2_4) if finite.any() else 1.0
