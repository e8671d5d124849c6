"""Robust resection: the motion of a stereo camera from points with covariances and their stereo views.

The robust start of every estimator and the outlier test of the front-end. Annealed Cauchy weights first (they
did not fail at 15 % outliers), then a χ² gate and a plain least-squares finish, so that the covariance is honest.
Where the weighted start finds no majority, minimal three-point hypotheses are tried.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import se3
from .gates import chi2_gates
from .se3 import Array
from .stereo import StereoProjection, whitening_of_views

_HYPOTHESES = 96  # at 50 % outliers, P(no clean triple) = (1 - 1/8)**96 < 3e-6
_MEDIAN_CHI2_4 = 3.36
_CAUCHY_WIDTH = 2.4**2  # 95 % efficiency on Gaussian noise
_MIN_DEPTH = 1e-3  # of a homogeneous point: in front of the camera


@dataclass(frozen=True, slots=True)
class Resection:
    """`cam_from_ref` (4, 4); `cov_pose` (6, 6): of ref_from_cam, right perturbation; `accepted` (n,) bool; `chi2`
    and `dof` of the accepted views; `spread`: median squared residual of all views over what it should be, at least 1;
    `ok`: at least six accepted views that determine the motion."""

    cam_from_ref: Array
    cov_pose: Array
    accepted: NDArray[np.bool_]
    chi2: float
    dof: int
    spread: float
    ok: bool


def homogeneous(points: Array, cov_points: Array | None) -> tuple[Array, Array | None]:
    """Points (n, 3) and covariances (n, 3, 3) as homogeneous ones (n, 4), (n, 4, 4)."""
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
    """Motion `cam_from_ref` that brings points onto their views, eqs. (20)–(23).

    `points_in_ref` (n, 3) metres or (n, 4) homogeneous, `cov_points` of the same dimension (None: exact),
    `z_px` (n, 4) with NaN where the right side is missing, `cov_px` (n, 4, 4), start (4, 4).
    """
    if points_in_ref.shape[-1] == 3:
        points_in_ref, cov_points = homogeneous(points_in_ref, cov_points)
    problem = _Problem(projection, points_in_ref, cov_points, z_px, cov_px, gate_probability)
    result = problem.solve(cam_from_ref_start)
    if len(z_px) >= 6 and result.accepted.mean() < 0.6:
        other = problem.solve(problem.best_hypothesis(cam_from_ref_start))
        if other.accepted.sum() > result.accepted.sum():
            result = other
    return result


class _Problem:
    def __init__(self, projection, points, cov_points, z_px, cov_px, gate_probability) -> None:
        self.projection = projection
        self.points = points
        self.cov_points = cov_points
        self.z_px = z_px
        self.z = np.nan_to_num(z_px)  # a missing side has no weight
        self.cov_px = cov_px
        self.sides = np.isfinite(z_px).sum(axis=1)  # measured coordinates: 4, or 2 without the right view
        self.gate = chi2_gates(self.sides, gate_probability)

    def linearise(self, cam_from_ref: Array) -> tuple[Array, Array]:
        """Roots (n, 4, 4) that whiten the residuals (view noise, and the points' own uncertainty seen from here), and
        the whitened Jacobian (n, 4, 6) of the left perturbation."""
        in_cam = self.points @ cam_from_ref.T
        in_cam = np.maximum(in_cam, _front(in_cam))
        j = self.projection.jacobian_homogeneous(in_cam)
        cov = self.cov_px
        if self.cov_points is not None:
            by_point = j @ cam_from_ref
            cov = cov + by_point @ self.cov_points @ np.swapaxes(by_point, -1, -2)
        root = whitening_of_views(self.z_px, cov)
        a = root @ j[..., :3]
        return root, np.concatenate([a * in_cam[:, None, 3:], -a @ se3.skew(in_cam[:, :3])], axis=2)

    def residuals(self, cam_from_ref: Array, root: Array) -> tuple[Array, Array]:
        """Whitened residuals (n, 4) and their squared norms (n,), inf behind the camera."""
        in_cam = self.points @ cam_from_ref.T
        behind = in_cam[:, 2] < _MIN_DEPTH
        in_cam = np.maximum(in_cam, _front(in_cam))
        r = (root @ (self.z - self.projection.project_homogeneous(in_cam))[..., None])[..., 0]
        return r, np.where(behind, np.inf, (r * r).sum(1))

    def step(self, cam_from_ref: Array, j: Array, r: Array, weight: Array) -> tuple[Array, float, Array]:
        """One weighted Gauss-Newton step, its squared length in standard deviations, and its information (6, 6)."""
        weighted = (j * weight[:, None, None]).reshape(-1, 6).T
        h, g = weighted @ j.reshape(-1, 6), weighted @ r.ravel()
        scale = 1 / np.sqrt(np.maximum(np.diag(h), 1e-12))
        delta = scale * np.linalg.lstsq(h * np.outer(scale, scale), g * scale, rcond=1e-10)[0]
        size = np.linalg.norm(delta[3:])
        if size > 0.3:  # a wild step from a bad start: keep its direction only
            delta *= 0.3 / size
        return se3.exp(delta) @ cam_from_ref, float(delta @ h @ delta), h

    def solve(self, cam_from_ref: Array) -> Resection:
        """Annealed weights, then the gate and plain least squares. The Jacobian is renewed after every third step:
        between them the pose moves too little to matter."""
        n = len(self.z_px)
        if n < 6:
            return Resection(cam_from_ref, np.full((6, 6), np.inf), np.zeros(n, bool), 0.0, 0, 1.0, False)
        root, j = self.linearise(cam_from_ref)
        r, s2 = self.residuals(cam_from_ref, root)
        for k in range(9):
            spread = _spread(s2)
            width = spread * (_CAUCHY_WIDTH if k > 2 else 6.0)
            cam_from_ref, moved, _ = self.step(cam_from_ref, j, r, 1 / (1 + s2 / width))
            if moved < 0.3 and (k > 1 or spread < 2):
                break
            if k % 3 == 2:
                root, j = self.linearise(cam_from_ref)
            r, s2 = self.residuals(cam_from_ref, root)
        if k > 0:  # a start that needed no second step was good enough to be linearised at
            root, j = self.linearise(cam_from_ref)
        r, s2 = self.residuals(cam_from_ref, root)
        accepted = s2 < self.gate
        for _ in range(4):
            cam_from_ref, moved, h = self.step(cam_from_ref, j, r, accepted.astype(float))
            r, s2 = self.residuals(cam_from_ref, root)
            before, accepted = accepted, s2 < self.gate
            if moved < 1e-2 and (before == accepted).all():
                break
        cov, ok = _inverse(h)
        dof = int(self.sides[accepted].sum()) - 6
        chi2 = float(s2[accepted].sum())
        cam_from_ref = se3.orthonormalised(cam_from_ref)
        return Resection(cam_from_ref, cov, accepted, chi2, dof, _spread(s2), ok and accepted.sum() >= 6)

    def best_hypothesis(self, start: Array) -> Array:
        """The best of many three-point alignments of triangulated views (Umeyama 1991), by truncated cost."""
        depth = self.projection.depth_m(self.z_px)
        usable = np.flatnonzero((self.sides == 4) & (depth > 0) & np.isfinite(depth) & (self.points[:, 3] > 1e-6))
        if len(usable) < 3:
            return start
        rng = np.random.default_rng(len(usable))  # fixed by the data: the same frame gives the same answer
        triples = usable[rng.random((_HYPOTHESES, len(usable))).argpartition(2, axis=1)[:, :3]]
        source = self.points[triples, :3] / self.points[triples, 3:]
        target = self.projection.triangulate(self.z_px[triples])
        ms, mt = source.mean(1, keepdims=True), target.mean(1, keepdims=True)
        u, _, vt = np.linalg.svd(np.swapaxes(target - mt, 1, 2) @ (source - ms))
        sign = np.linalg.det(u) * np.linalg.det(vt)
        u[:, :, 2] *= sign[:, None]
        rotation = u @ vt
        translation = (mt - ms @ np.swapaxes(rotation, 1, 2))[:, 0]
        candidates = np.concatenate([start[None], se3.from_rotation_translation(rotation, translation)])
        cov = self.cov_px + 4 * np.eye(4)  # triples are noisy: a tolerant score ranks them better
        root = whitening_of_views(self.z_px, cov)
        costs = [np.minimum(self.residuals(c, root)[1], 9.0).sum() for c in candidates]
        return candidates[int(np.argmin(costs))]


def _spread(s2: Array) -> float:
    finite = np.isfinite(s2)
    return max(1.0, float(np.median(s2[finite])) / _MEDIAN_CHI2_4) if finite.any() else 1.0


def _front(in_cam: Array) -> Array:
    """Lower bound that keeps depth positive and touches nothing else."""
    bound = np.full(in_cam.shape, -np.inf)
    bound[..., 2] = _MIN_DEPTH
    return bound


def _inverse(h: Array) -> tuple[Array, bool]:
    """Inverse of an information matrix, scaled by its diagonal first; ok is False when it is singular."""
    d = np.diag(h)
    if (d <= 0).any():
        return np.full((6, 6), np.inf), False
    scale = 1 / np.sqrt(d)
    scaled = h * np.outer(scale, scale)
    if np.linalg.cond(scaled) > 1e10:
        return np.full((6, 6), np.inf), False
    cov = np.linalg.inv(scaled) * np.outer(scale, scale)
    return (cov + cov.T) / 2, True
