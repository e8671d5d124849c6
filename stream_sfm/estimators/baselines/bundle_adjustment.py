"""Euclidean bundle adjustment over stereo views: residuals, normal equations, Schur complement, covariances.

It minimises Σ (z − h(X))ᵀ Ω (z − h(X)) over poses `ref_from_cam` ⊞ ξ and points in `ref`, plus Gaussian priors on
single points. With A = ∂z/∂X at the point in the camera and R of cam_from_ref,
∂z/∂ξ = A [−I, [X]×] (right perturbation of ref_from_cam) and ∂z/∂X_ref = A R, eq. (44).
Points are eliminated: S = U − W V⁻¹ Wᵀ (Triggs et al., Bundle Adjustment: A Modern Synthesis, section 6.1).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...geometry import se3
from ...geometry.linear import Cholesky, matvec, symmetric, symmetric_inverse
from ...geometry.se3 import Array
from ...geometry.stereo import MIN_DEPTH, StereoProjection, information_of_views

# Levenberg-Marquardt: a damping d multiplies the diagonal of the normal equations by 1 + d. Small at first, because the
# starts are robust motions near the minimum; changed a hundredfold, so that few trials find a value that works.
_FIRST_DAMPING = 1e-7
_LEAST_DAMPING = 1e-12  # no effect on a step, yet a hundred times it is still small
_LEAST_DAMPING_AFTER_FAILURE = 1e-6
_DAMPING_FACTOR = 100.0
_MAX_TRIALS = 8  # dampings per iteration: up to 10⁶ at least, where a step is a short one down the gradient
_ROUNDING = 1e-14  # relative increase of the sum of squares that is rounding of the sum and not a failure
_LEAST_DECREASE = 1e-12  # squared standard deviations: converged, where an exact fit leaves nothing to compare with


@dataclass(frozen=True, slots=True)
class WeightedViews:
    """Stereo views as flat rows, sorted by point.

    `frame` (k,), `point` (k,) indices from 0, every point at least once; `z_px` (k, 4) without NaN; `information`
    (k, 4, 4), zero where a side is missing.
    """

    frame: NDArray[np.intp]
    point: NDArray[np.intp]
    z_px: Array
    information: Array

    @classmethod
    def sorted_by_point(
        cls, frame: NDArray[np.intp], point: NDArray[np.intp], z_px: Array, cov_px: Array
    ) -> "WeightedViews":
        """Return the views of rows in any order; `cov_px` (k, 4, 4) px², `z_px` NaN where the right side is missing."""
        order = np.lexsort((frame, point))
        z, cov = z_px[order], cov_px[order]
        return cls(frame[order], point[order], np.nan_to_num(z), information_of_views(z, cov))


@dataclass(frozen=True, slots=True)
class PointPriors:
    """Independent Gaussian priors of points: `mean` (p, 3) m, `information` (p, 3, 3) m⁻², zero for none."""

    mean: Array
    information: Array


def residuals_and_jacobians(
    projection: StereoProjection, ref_from_cam: Array, points: Array, views: WeightedViews
) -> tuple[Array, Array, Array]:
    """Return residuals z − h (k, 4), ∂h/∂ξ (k, 4, 6) of each view's camera, ∂h/∂X (k, 4, 3) of its point in ref."""
    cam_from_ref = se3.inverse(ref_from_cam)[views.frame]
    in_cam = matvec(cam_from_ref[:, :3, :3], points[views.point]) + cam_from_ref[:, :3, 3]
    a = projection.jacobian(in_cam)
    j_pose = np.concatenate([-a, a @ se3.skew(in_cam)], axis=2)
    return views.z_px - projection.project(in_cam), j_pose, a @ cam_from_ref[:, :3, :3]


def cost(
    projection: StereoProjection,
    ref_from_cam: Array,
    points: Array,
    views: WeightedViews,
    priors: PointPriors | None,
) -> tuple[float, Array]:
    """Return the sum of squares, inf where a point is behind its camera, and the part of each view (k,)."""
    cam_from_ref = se3.inverse(ref_from_cam)[views.frame]
    in_cam = matvec(cam_from_ref[:, :3, :3], points[views.point]) + cam_from_ref[:, :3, 3]
    if not (in_cam[:, 2] > MIN_DEPTH).all():
        return np.inf, np.full(len(in_cam), np.inf)
    r = views.z_px - projection.project(in_cam)
    squares = np.einsum("ki,kij,kj->k", r, views.information, r)
    total = float(squares.sum())
    if priors is not None:
        d = points - priors.mean
        total += float(np.einsum("pi,pij,pj->", d, priors.information, d))
    return total, squares


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """The normal equations: U (b, 6, 6), V (p, 3, 3), W (p, 3, 6b) of points and poses, gradients (b, 6), (p, 3)."""

    u: Array
    w: Array
    v: Array
    g_pose: Array
    g_point: Array

    @classmethod
    def build(
        cls,
        projection: StereoProjection,
        ref_from_cam: Array,
        points: Array,
        views: WeightedViews,
        priors: PointPriors | None = None,
    ) -> "NormalEquations":
        """Linearise at the given poses (b, 4, 4) and points (p, 3)."""
        b, p = len(ref_from_cam), len(points)
        r, j_pose, j_point = residuals_and_jacobians(projection, ref_from_cam, points, views)
        jt_pose = np.swapaxes(j_pose, 1, 2) @ views.information
        jt_point = np.swapaxes(j_point, 1, 2) @ views.information
        w = np.zeros((p, b, 3, 6))
        w[views.point, views.frame] = jt_point @ j_pose
        v = _sum_by_point(views, jt_point @ j_point)
        g_point = _sum_by_point(views, matvec(jt_point, r))
        if priors is not None:
            v = v + priors.information
            g_point = g_point + matvec(priors.information, priors.mean - points)
        return cls(
            u=_sum_by_frame(views, jt_pose @ j_pose, b),
            w=np.ascontiguousarray(np.swapaxes(w, 1, 2)).reshape(p, 3, 6 * b),
            v=v,
            g_pose=_sum_by_frame(views, matvec(jt_pose, r), b),
            g_point=g_point,
        )

    def eliminate_points(self, free: NDArray[np.bool_], damping: float = 0.0) -> "Reduced":
        """Return the Schur complement onto the poses marked `free` (b,); the others are held exactly."""
        columns = np.repeat(free, 6)
        v = self.v * (1 + damping * np.eye(3))
        v_inv = symmetric_inverse(v)
        w = self.w[:, :, columns]
        y = v_inv @ w
        n = w.shape[2]
        b = int(free.sum())
        s = np.zeros((b, 6, b, 6))
        s[np.arange(b), :, np.arange(b), :] = self.u[free] * (1 + damping * np.eye(6))
        s = s.reshape(n, n) - w.reshape(3 * len(w), n).T @ y.reshape(3 * len(w), n)
        g = self.g_pose[free].ravel() - y.reshape(3 * len(w), n).T @ self.g_point.ravel()
        return Reduced(symmetric(s), g, v_inv, y)


@dataclass(frozen=True, slots=True)
class Reduced:
    """The reduced system: S (6b, 6b) and its right side over the free poses, V⁻¹ (p, 3, 3) and V⁻¹Wᵀ (p, 3, 6b)."""

    s: Array
    g: Array
    v_inv: Array
    y: Array

    def solve(self, g_point: Array) -> tuple[Array, Array]:
        """Return steps of poses (b, 6) and points (p, 3). Raises LinAlgError where S is not positive definite."""
        xi = Cholesky(self.s, repair=False).solve(self.g) if len(self.s) else np.zeros(0)
        points = matvec(self.v_inv, g_point) - self.y @ xi
        return xi.reshape(-1, 6), points

    def cov_poses(self) -> Array:
        """Return S⁻¹ (6b, 6b), m² and rad²."""
        if not len(self.s):
            return self.s
        return Cholesky(self.s, repair=False).inverse()


@dataclass(frozen=True, slots=True)
class Covariances:
    """The joint covariance of the free poses (6b, 6b), and of every point with them.

    `cov_points` (p, 3, 3) m² in ref; `cross` (p, 3, 6b) of points with poses.
    """

    free: NDArray[np.bool_]
    cov_poses: Array
    cov_points: Array
    cross: Array

    @classmethod
    def of(cls, reduced: Reduced, free: NDArray[np.bool_], points: NDArray[np.intp] | None = None) -> "Covariances":
        """Invert the reduced system; `points` selects for which points (default all)."""
        cov = reduced.cov_poses()
        y = reduced.y if points is None else reduced.y[points]
        v_inv = reduced.v_inv if points is None else reduced.v_inv[points]
        cross = -y @ cov
        cov_points = v_inv - cross @ np.swapaxes(y, 1, 2)
        return cls(free, cov, symmetric(cov_points), cross)

    def columns(self, frame: int) -> slice | None:
        """Return the columns of a frame's pose, or None where it is held."""
        if not self.free[frame]:
            return None
        k = 6 * int(self.free[:frame].sum())
        return slice(k, k + 6)

    def cov_pose(self, frame: int) -> Array:
        """Return the covariance (6, 6) of one pose, zero where it is held."""
        c = self.columns(frame)
        return np.zeros((6, 6)) if c is None else self.cov_poses[c, c]

    def cov_points_in_cam(self, frame: int, ref_from_cam: Array, points_in_cam: Array) -> Array:
        """Return covariances (p, 3, 3) of points carried into one camera, eq. (45): δX_c = R δX + [−I, [X_c]×] ξ."""
        r = ref_from_cam[:3, :3].T
        cov = r @ self.cov_points @ r.T
        c = self.columns(frame)
        if c is not None:
            j = se3.point_in_source_jacobian(points_in_cam)
            mixed = r @ self.cross[:, :, c] @ np.swapaxes(j, 1, 2)
            cov = cov + mixed + np.swapaxes(mixed, 1, 2) + j @ self.cov_poses[c, c] @ np.swapaxes(j, 1, 2)
        return symmetric(cov)


@dataclass(frozen=True, slots=True)
class Adjustment:
    """The minimum: poses (b, 4, 4), points (p, 3), the sum of squares and the part of each view (k,)."""

    ref_from_cam: Array
    points: Array
    cost: float
    squares: Array
    iterations: int
    converged: bool


def adjust(
    projection: StereoProjection,
    ref_from_cam: Array,
    points: Array,
    views: WeightedViews,
    free: NDArray[np.bool_],
    priors: PointPriors | None = None,
    max_iterations: int = 20,
    tolerance: float = 1e-10,
) -> Adjustment:
    """Minimise by Levenberg-Marquardt from a start.

    Ends where the sum of squares falls by less than `tolerance` of itself, or where no step lowers it, which is the
    minimum to rounding; `converged` is False where the iterations ran out first.
    """
    best, squares = cost(projection, ref_from_cam, points, views, priors)
    damping, done, converged = _FIRST_DAMPING, 0, False
    while done < max_iterations and np.isfinite(best) and not converged:
        normal = NormalEquations.build(projection, ref_from_cam, points, views, priors)
        done += 1
        improved = False
        for _ in range(_MAX_TRIALS):
            try:
                xi, delta = normal.eliminate_points(free, damping).solve(normal.g_point)
            except np.linalg.LinAlgError:
                damping = max(damping * _DAMPING_FACTOR, _LEAST_DAMPING_AFTER_FAILURE)
                continue
            poses = ref_from_cam.copy()
            poses[free] = se3.orthonormalise(ref_from_cam[free] @ se3.exp(xi))
            value, new_squares = cost(projection, poses, points + delta, views, priors)
            if value <= best * (1 + _ROUNDING):
                converged = best - value <= tolerance * best + _LEAST_DECREASE
                ref_from_cam, points, best, squares = poses, points + delta, value, new_squares
                damping, improved = max(damping / _DAMPING_FACTOR, _LEAST_DAMPING), True
                break
            damping = max(damping * _DAMPING_FACTOR, _LEAST_DAMPING_AFTER_FAILURE)
        if not improved:
            converged = np.isfinite(best)  # no step helps: at the minimum, to rounding
            break
    return Adjustment(ref_from_cam, points, best, squares, done, bool(converged))


def _sum_by_point(views: WeightedViews, values: Array) -> Array:
    """Sum the rows of `values` (k, …) of each point; views are sorted by point."""
    starts = np.flatnonzero(np.diff(views.point, prepend=-1))
    return np.add.reduceat(values, starts, axis=0)


def _sum_by_frame(views: WeightedViews, values: Array, n: int) -> Array:
    """Sum the rows of `values` (k, …) of each frame in [0, n)."""
    one_hot = np.zeros((n, len(values)))
    one_hot[views.frame, np.arange(len(values))] = 1.0
    return (one_hot @ values.reshape(len(values), -1)).reshape(n, *values.shape[1:])
