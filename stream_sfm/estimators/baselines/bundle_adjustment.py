"""Euclidean bundle adjustment over stereo views: residuals, normal equations, Schur complement, covariances.

It minimises Σ (z − h(X))ᵀ Ω (z − h(X)) over poses `ref_from_cam` ⊞ ξ and points in `ref`, plus Gaussian priors on
single points. With A = ∂z/∂X at the point in the camera and R of cam_from_ref,
∂z/∂ξ = A [−I, [X]×] (right perturbation of ref_from_cam) and ∂z/∂X_ref = A R, eq. (44).
Points are eliminated: S = U − W V⁻¹ Wᵀ (Triggs et al., Bundle Adjustment: A Modern Synthesis, section 6.1).
"""

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...geometry import Array, se3
from ...geometry.linear import Cholesky, matvec, symmetric
from ...geometry.stereo import MIN_DEPTH, StereoProjection, information_of_views
from ...record import record


@record
class WeightedViews:
    """Stereo views as flat rows, sorted by point.

    `frame` (k,), `point` (k,) indices from 0; `z_px` (k, 4) without NaN; `information`
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
        """Return views from rows in any order; `cov_px` (k, 4, 4) px², `z_px` NaN where the right side is missing."""
        order = np.lexsort((frame, point))
        z, cov = z_px[order], cov_px[order]
        return cls(frame[order], point[order], np.nan_to_num(z), information_of_views(z, cov))


@record
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


@record
class Reduced:
    """The normal equations without the points, S = U − W V⁻¹ Wᵀ (n, n), and their right side `g` (n,).

    The first unknowns are the poses marked `free` (b,), six each; the other poses are fixed. For the points: `root` L
    (p, 3, 3) with L Lᵀ = V⁻¹, `reach` LᵀW (p, 3, n), and `g_point` (p, 3).
    """

    free: NDArray[np.bool_]
    s: Array
    g: Array
    root: Array
    reach: Array
    g_point: Array

    @classmethod
    def eliminate(cls, free: NDArray[np.bool_], u: Array, w: Array, v: Array, g: Array, g_point: Array) -> "Reduced":
        """Eliminate the points from U (n, n), W (p, 3, n), V (p, 3, 3). Raises LinAlgError if V is not definite."""
        root, reach = core.eliminate_points(v, w)
        flat = reach.reshape(3 * len(v), len(u))
        given = matvec(np.swapaxes(root, 1, 2), g_point)
        return cls(free, symmetric(u - flat.T @ flat), g - flat.T @ given.ravel(), root, reach, g_point)

    def solve(self) -> tuple[Array, Array]:
        """Return steps of poses (b, 6) and points (p, 3). Raises LinAlgError if S is not positive definite."""
        xi = Cholesky(self.s, repair=False).solve(self.g) if len(self.s) else np.zeros(0)
        given = matvec(np.swapaxes(self.root, 1, 2), self.g_point)
        return xi.reshape(-1, 6), matvec(self.root, given - self.reach @ xi)

    def covariances(self, points: NDArray[np.intp] | slice = slice(None)) -> "Covariances":
        """Return S⁻¹ with the covariances of the selected points."""
        cov = Cholesky(self.s, repair=False).inverse() if len(self.s) else self.s
        root, reach = self.root[points], self.reach[points]
        cross = root @ reach @ cov
        cov_points = root @ np.swapaxes(root, 1, 2) + cross @ np.swapaxes(root @ reach, 1, 2)
        return Covariances(self.free, cov, symmetric(cov_points), -cross)


@record
class Covariances:
    """The joint covariance of the unknowns of `Reduced` (n, n), and of every point with them.

    `cov_points` (p, 3, 3) m² in ref; `cross` (p, 3, n) of points with the others.
    """

    free: NDArray[np.bool_]
    cov_poses: Array
    cov_points: Array
    cross: Array

    def columns(self, frame: int) -> slice | None:
        """Return the columns of a frame's pose, or None if it is fixed."""
        if not self.free[frame]:
            return None
        k = 6 * int(self.free[:frame].sum())
        return slice(k, k + 6)

    def cov_pose(self, frame: int) -> Array:
        """Return the covariance (6, 6) of one pose, zero if it is fixed."""
        c = self.columns(frame)
        return np.zeros((6, 6)) if c is None else self.cov_poses[c, c]

    def cov_points_in_cam(self, frame: int, ref_from_cam: Array, points_in_cam: Array) -> Array:
        """Return covariances (p, 3, 3) of points in one camera, eq. (45): δX_c = R δX + [−I, [X_c]×] ξ."""
        r = ref_from_cam[:3, :3].T
        cov = r @ self.cov_points @ r.T
        c = self.columns(frame)
        if c is not None:
            j = se3.point_in_source_jacobian(points_in_cam)
            mixed = r @ self.cross[:, :, c] @ np.swapaxes(j, 1, 2)
            cov = cov + mixed + np.swapaxes(mixed, 1, 2) + j @ self.cov_poses[c, c] @ np.swapaxes(j, 1, 2)
        return symmetric(cov)


@record
class Adjustment:
    """The minimum: poses (b, 4, 4), points (p, 3), the sum of squares and the term of each view (k,)."""

    ref_from_cam: Array
    points: Array
    cost: float
    squares: Array
    iterations: int


@record
class Problem:
    """Poses and points to be estimated from views; of the poses only those marked `free` (b,), the others are fixed."""

    projection: StereoProjection
    views: WeightedViews
    free: NDArray[np.bool_]
    priors: PointPriors | None = None

    def cost(self, ref_from_cam: Array, points: Array) -> tuple[float, Array]:
        """Return the sum of squares, inf if a point is behind its camera, and the term of each view (k,)."""
        views, priors = self.views, self.priors
        cam_from_ref = se3.inverse(ref_from_cam)[views.frame]
        in_cam = matvec(cam_from_ref[:, :3, :3], points[views.point]) + cam_from_ref[:, :3, 3]
        if not (in_cam[:, 2] > MIN_DEPTH).all():
            return np.inf, np.full(len(in_cam), np.inf)
        r = views.z_px - self.projection.project(in_cam)
        squares = np.einsum("ki,kij,kj->k", r, views.information, r)
        total = float(squares.sum())
        if priors is not None:
            d = points - priors.mean
            total += float(np.einsum("pi,pij,pj->", d, priors.information, d))
        return total, squares

    def linearised(self, ref_from_cam: Array, points: Array) -> Reduced:
        """Return the normal equations at the given poses (b, 4, 4) and points (p, 3)."""
        views, free, priors = self.views, self.free, self.priors
        b, p, n = len(ref_from_cam), len(points), 6 * int(free.sum())
        r, j_pose, j_point = residuals_and_jacobians(self.projection, ref_from_cam, points, views)
        j = np.concatenate([j_pose, j_point, r[..., None]], axis=2)
        blocks = np.zeros((p, b, 10, 10))  # of each view: pose, point and residual
        blocks[views.point, views.frame] = np.swapaxes(j, 1, 2) @ views.information @ j
        of_poses, of_points = blocks.sum(axis=0)[free], blocks.sum(axis=1)
        u = np.zeros((n // 6, 6, n // 6, 6))
        u[np.arange(n // 6), :, np.arange(n // 6), :] = of_poses[:, :6, :6]
        w = blocks[:, free, 6:9, :6].swapaxes(1, 2).reshape(p, 3, n)
        v, g_point = of_points[:, 6:9, 6:9].copy(), of_points[:, 6:9, 9]
        if priors is not None:
            v, g_point = v + priors.information, g_point + matvec(priors.information, priors.mean - points)
        return Reduced.eliminate(free, u.reshape(n, n), w, v, of_poses[:, :6, 9].ravel(), g_point)

    def minimum(self, ref_from_cam: Array, points: Array, max_iterations: int, tolerance: float = 1e-10) -> Adjustment:
        """Minimise by Gauss-Newton, with steps halved until they decrease the sum of squares.

        The iteration ends if the relative decrease is less than `tolerance`, if no step decreases the sum, which is the
        minimum up to rounding, or after `max_iterations`. Raises LinAlgError if the views do not determine the poses.
        """
        best, squares = self.cost(ref_from_cam, points)
        done, converged = 0, False
        while done < max_iterations and np.isfinite(best) and not converged:
            xi, delta = self.linearised(ref_from_cam, points).solve()
            done, before = done + 1, best
            for scale in 0.5 ** np.arange(8):  # starts are near the minimum: further halvings do not help
                poses = ref_from_cam.copy()
                poses[self.free] = se3.orthonormalise(ref_from_cam[self.free] @ se3.exp(scale * xi))
                value, new_squares = self.cost(poses, points + scale * delta)
                if value <= best * (1 + 1e-14):  # a smaller increase is rounding of the sum
                    ref_from_cam, points, best, squares = poses, points + scale * delta, value, new_squares
                    break
            converged = before - best <= tolerance * before + 1e-12  # an exact fit leaves nothing to compare with
        return Adjustment(ref_from_cam, points, best, squares, done)
