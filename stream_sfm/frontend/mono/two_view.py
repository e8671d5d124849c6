"""The motion of one camera between two images, up to scale, and the resulting depths, eqs. (64) and (65).

The five-point method in RANSAC (Nistér, PAMI 2004; OpenCV's) finds it. Least squares of Sampson distances refine it in
its five observable degrees of freedom. |t| = 1: the first baseline is the unit of length from then on. A planar scene
allows two motions; the one with more points in front is used.
"""

from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray

from ...config.section import Section, expert
from ...geometry import Array, se3
from ...geometry.stereo import MIN_INVERSE_DEPTH_SIGMAS
from ...record import record
from .parallax import depths_from_motion, directions


class MonoRules(Section, frozen=True, kw_only=True):
    """With one camera: when a map begins, and the weight of its depths."""

    # A motion that puts more points behind the camera is wrong.
    min_in_front: Annotated[float, expert("least share of points in front of the camera", 0, 1)] = 0.5
    # Estimators also get the views from which depths were learnt. In simulation (tests/estimators/test_mono.py) the
    # mean NEES of the pose is then 3.8 and 3.7 for two motions (6 is expected); with 0.4 it was 8.9 and 6.9.
    depth_std_factor: Annotated[float, expert("factor on the σ of depths that estimators get", 0.01, 100)] = 2.0
    # One σ covers everything from infinity to a quarter of the distance of the scene, so the first parallax
    # outweighs it.
    unknown_depth: Annotated[float, expert("σ of an unknown inverse depth, medians of the scene", 0.01, 1000)] = 3.0
    # With fewer, the rest may be a single moving object.
    min_tracks: Annotated[int, expert("least number of points tracked since the opening frame", 8, 2000)] = 30
    min_followed: Annotated[float, expert("least share of the points of the opening frame", 0, 1)] = 0.5
    # One good ray in 2 000 is lost.
    gate_sigmas: Annotated[float, expert("largest distance of a ray from its epipolar line, σ", 0.1, 1000)] = 3.5
    # OpenCV's default is 0.999.
    ransac_confidence: Annotated[float, expert("probability of a clean RANSAC draw", 0.5, 0.999999)] = 0.9999
    # The usual width is 1.3, but RANSAC has already removed the outliers.
    huber_sigmas: Annotated[float, expert("width of Huber's loss, σ", 0.1, 1000)] = 2.0
    # A map begins when these hold; with stricter limits it begins later, with looser ones its first depths are worse.
    min_agreement: Annotated[float, expert("share of rays that one motion must explain", 0, 1)] = 0.7
    min_significance: Annotated[float, expert("least median of inverse depth over its σ", 1, 1e6)] = 10.0
    max_std_direction_rad: Annotated[float, expert("largest σ of the motion's direction, rad", 1e-4, 10)] = 0.035
    # Nearer points were passed or mismatched.
    min_depth: Annotated[float, expert("least current depth, share of the first depth", 0, 1)] = 0.05


@record
class TwoView:
    """The motion between two views of one camera, and the resulting depths.

    `now_from_first` (4, 4) with |t| = 1; `cov_first_from_now` (6, 6); `agree` (n,) bool: rays that fit it, with points
    in front of both cameras; `rho`, `var_rho` (n,): inverse depths in the first camera.
    """

    now_from_first: Array
    cov_first_from_now: Array
    agree: NDArray[np.bool_]
    rho: Array
    var_rho: Array
    rules: MonoRules

    @property
    def problem(self) -> str:
        """Why no map can begin with it, or an empty string."""
        agreement, rules = self.agree.mean(), self.rules
        if agreement < rules.min_agreement:
            explained, needed = 100 * agreement, 100 * rules.min_agreement
            return f"one motion explains {explained:.0f} % of the points, {needed:.0f} % are needed"
        significance = float(np.median(self.rho[self.agree] / np.sqrt(self.var_rho[self.agree])))
        if significance < rules.min_significance:
            known = f"known to {100 / significance:.0f} %" if significance > 1 else "not known"
            return f"too little parallax yet: depths are {known}, {100 / rules.min_significance:.0f} % are needed"
        worst = float(np.sqrt(np.linalg.eigvalsh(self.cov_first_from_now[:3, :3])[-1]))
        if worst > rules.max_std_direction_rad:
            return f"the direction of motion is known only to {worst:.2f} rad, {rules.max_std_direction_rad} are needed"
        return ""


def two_view_motion(rays_first: Array, rays_now: Array, std_ray: float, rules: MonoRules) -> TwoView | None:
    """Return the motion between two sets of rays (n, 2) = (X/Z, Y/Z) of the same points, or None if there is none.

    `std_ray`: the standard deviation of the rays in both views.
    """
    if len(rays_first) < 8:  # five for the minimal solver, and some to distinguish its solutions
        return None
    cv2.setRNGSeed(0)  # the same rays give the same answer
    essential, inliers = cv2.findEssentialMat(
        rays_first,
        rays_now,
        np.eye(3),
        method=cv2.RANSAC,
        prob=rules.ransac_confidence,
        threshold=rules.gate_sigmas * std_ray,
    )
    if essential is None or essential.shape != (3, 3):
        return None
    # By default OpenCV excludes points beyond 50 baselines.
    _, rotation, t, *_ = cv2.recoverPose(
        essential, rays_first, rays_now, np.eye(3), distanceThresh=1e6, mask=inliers.copy()
    )
    inlier = inliers[:, 0] > 0
    start = se3.from_rotation_translation(rotation, t[:, 0])
    pose, cov = _refined(start, rays_first[inlier], rays_now[inlier], std_ray, rules)
    rho, var_rho = depths_from_motion(pose, rays_first, rays_now, 2 * std_ray**2 * np.eye(2))  # of both
    depth_now = directions(pose, rays_first)[:, 2] + pose[2, 3] * rho  # relative to the depth in the first camera
    agree = (np.abs(_sampson(pose, rays_first, rays_now) / std_ray) < rules.gate_sigmas) & (
        rho > MIN_INVERSE_DEPTH_SIGMAS * np.sqrt(var_rho)
    )
    agree &= depth_now > rules.min_depth
    return TwoView(pose, cov, agree, rho, var_rho, rules)


def _refined(start: Array, rays_first: Array, rays_now: Array, std_ray: float, rules: MonoRules) -> tuple[Array, Array]:
    """Return the motion (4, 4) near a start that fits the rays best, and its covariance (6, 6)."""
    from scipy.optimize import least_squares  # takes a quarter of a second, and only one camera needs it

    across = np.linalg.svd(start[:3, 3:].T)[2][1:]  # two directions across t

    def moved(x: Array) -> Array:
        direction = start[:3, 3] + x[3:] @ across
        return se3.from_rotation_translation(se3.exp_so3(x[:3]) @ start[:3, :3], direction / np.linalg.norm(direction))

    def distances(x: Array) -> Array:
        return _sampson(moved(x), rays_first, rays_now) / std_ray

    found = least_squares(distances, np.zeros(5), loss="huber", f_scale=rules.huber_sigmas)
    pose = moved(found.x)
    # R' = Exp(w) R, t' = t + a·across is Exp(−ξ) applied on the left, ξ = (w × t − a·across, −w)
    by_x = np.zeros((6, 5))
    by_x[:3, :3], by_x[:3, 3:], by_x[3:, :3] = -se3.skew(pose[:3, 3]), -across.T, -np.eye(3)
    cov = by_x @ np.linalg.pinv(found.jac.T @ found.jac) @ by_x.T
    # |t| is exact, but the depths that preserve the unit agree with it about as well as they fix its direction
    cov[:3, :3] += np.linalg.eigvalsh(cov[:3, :3])[-1] * np.outer(pose[:3, 3], pose[:3, 3])
    return pose, cov


def _sampson(now_from_first: Array, rays_first: Array, rays_now: Array) -> Array:
    """Return distances (n,) to the epipolar lines to first order, eq. (64) (Hartley and Zisserman, section 11.4.3)."""
    e = se3.skew(now_from_first[:3, 3]) @ now_from_first[:3, :3]
    one = np.ones((len(rays_first), 1))
    a, b = np.concatenate([rays_first, one], axis=1), np.concatenate([rays_now, one], axis=1)
    line_now, line_first = a @ e.T, b @ e
    scale = np.sqrt((line_now[:, :2] ** 2).sum(1) + (line_first[:, :2] ** 2).sum(1))
    return np.asarray((b * line_now).sum(1) / np.maximum(scale, 1e-12))
