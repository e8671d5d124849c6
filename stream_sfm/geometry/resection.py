"""Robust resection: the motion of a stereo camera from points with covariances and their stereo views.

Every estimator starts a frame from it, and the front-end takes its outlier test from it. Cauchy weights come first,
wide and then narrow; then a χ² gate and plain least squares over the accepted views, so that the covariance is that of
Gaussian noise. Where too few views agree with what a start led to, the whole space of motions is searched
(`motion_search.py`), and it is looked whether the views that disagree have another motion in common.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from . import se3
from .linear import damped_solve, scaled_inverse
from .medians import median
from .motion_search import evidence, search_motion, support
from .point_views import PointViews
from .se3 import Array
from .stereo import StereoProjection

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
# The global search costs a few ms: it is made where less of the weight than this agrees with the motion found. Calm
# frames of the sample logs accept more than 0.85. (Where all squared residuals are twice too large 0.94 are accepted,
# where they are four times too large 0.67.)
_CALM_SHARE = 0.8
# From a close start noise may be twice what was assumed before the search is made: a drone that is shaken has squared
# residuals of up to 3.3 times their expected size, and 12 ms of a frame's 30 went into searches that found nothing.
_CALM_SPREAD = 4.0
_SPREAD_WITHIN = 10.0  # gates: views further off belong to something else and say nothing about the noise
# A second motion is a rival where it has at least this share of the first one's evidence. Bodies that pass in a room
# have up to .05 of it on the sample logs, and up to .09 where they are there before anything has a history.
_RIVAL_SHARE = 0.1
_RIVAL_BEYOND = 2.0  # gates: views that are clearly not of the first motion
_MIN_RIVAL_VIEWS = 8  # two determine a motion; six more do not agree with it by chance


@dataclass(frozen=True, slots=True)
class SecondMotion:
    """What views that clearly disagree with a motion have in common: another one, `cam_from_ref` (4, 4).

    `cov_pose` (6, 6): of ref_from_cam, right perturbation. `views` (n,) bool: which agree with this motion only;
    `odds`: their evidence over that of the views which agree with the first motion only.
    """

    cam_from_ref: Array
    cov_pose: Array
    views: NDArray[np.bool_]
    odds: float

    @property
    def is_rival(self) -> bool:
        """Whether the views cannot tell which of the two motions is that of the background."""
        return self.odds >= _RIVAL_SHARE


@dataclass(frozen=True, slots=True)
class Resection:
    """The motion that brings points onto their views.

    `cam_from_ref` (4, 4); `cov_pose` (6, 6): of ref_from_cam, right perturbation; `accepted` (n,) bool; `chi2` and
    `dof` of the accepted views; `spread`: median squared residual of the views that may belong to the motion over its
    expected value, at least 1; `ok`: enough accepted views, and they determine the motion. `squared_residuals` (n,): of
    all views, whitened. `share`: of the weight that the accepted views have; `second`: what others agree on.
    """

    cam_from_ref: Array
    cov_pose: Array
    accepted: NDArray[np.bool_]
    chi2: float
    dof: int
    spread: float
    ok: bool
    squared_residuals: Array
    share: float = 0.0
    second: SecondMotion | None = None

    @property
    def rival(self) -> SecondMotion | None:
        """The second motion where the views cannot tell which of the two is that of the background."""
        return self.second if self.second and self.second.is_rival else None


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
    weights: Array | None = None,
    start_is_close: bool = False,
    find_second: bool = True,
) -> Resection:
    """Find the motion `cam_from_ref` that brings points onto their views, eqs. (20)–(23).

    `points_in_ref` (n, 3) metres or (n, 4) homogeneous, `cov_points` of the same dimension (None: exact),
    `z_px` (n, 4) with NaN where the right side is missing, `cov_px` (n, 4, 4), start (4, 4). `weights` (n,): how much
    each view counts where sets of views vote for different motions (None: all the same); among the views of one motion
    only their noise counts. `start_is_close`: the start is already a motion that most of these views agree on, the best
    of any; where nearly all of them do, neither another start nor annealing is needed. `find_second`: whether a second
    motion is looked for.
    """
    n = len(z_px)
    if n < MIN_VIEWS:
        unknown = np.full((6, 6), np.inf)
        return Resection(cam_from_ref_start, unknown, np.zeros(n, bool), 0.0, 0, 1.0, False, np.full(n, np.inf))
    if points_in_ref.shape[-1] == 3:
        points_in_ref, cov_points = homogeneous(points_in_ref, cov_points)
    views = PointViews(projection, points_in_ref, cov_points, z_px, cov_px, gate_probability)
    weights = np.ones(len(views)) if weights is None else weights
    if start_is_close:
        found = _least_squares(views, weights, cam_from_ref_start, *views.linearise(cam_from_ref_start))
        if found.ok and _agrees_with_nearly_all(views, found, weights):
            return found
    found = _solve(views, cam_from_ref_start, weights)
    if found.share < _CALM_SHARE:
        other = _search(views, cam_from_ref_start, weights)
        if other.ok and _support(views, other.cam_from_ref, weights) > _support(views, found.cam_from_ref, weights):
            found = other
    return _with_second_motion(views, found, weights) if find_second else found


def _solve(views: PointViews, cam_from_ref: Array, weights: Array) -> Resection:
    """Anneal Cauchy weights, gate, and finish with plain least squares over the accepted views."""
    return _least_squares(views, weights, *_robust_fit(views, cam_from_ref))


def _agrees_with_nearly_all(views: PointViews, found: Resection, weights: Array) -> bool:
    """Whether nearly all views agree with the motion, if their noise is as large as their median residual says."""
    agree = found.squared_residuals < min(found.spread, _CALM_SPREAD) * views.gate
    return bool(weights[agree].sum() >= _CALM_SHARE * weights.sum())


def _search(views: PointViews, cam_from_ref: Array, weights: Array) -> Resection:
    """Search for the motion of largest support, and finish it with plain least squares.

    No annealing: among many views that move together even small weights would lead away from it.
    """
    motion = search_motion(views, cam_from_ref, weights)
    return _least_squares(views, weights, motion, *views.linearise(motion))


def _support(views: PointViews, cam_from_ref: Array, weights: Array) -> float:
    """Return the support of one motion, whitened where it is."""
    root, _ = views.linearise(cam_from_ref)
    return float(support(views, cam_from_ref[None], root, weights)[0])


def _with_second_motion(views: PointViews, found: Resection, weights: Array) -> Resection:
    """Add the motion that the views which clearly disagree have in common, or exchange the two where that is clear.

    Many views may agree with both motions; they say nothing about which of the two is that of the background.
    """
    off = found.squared_residuals > _RIVAL_BEYOND * views.gate
    if not found.ok or off.sum() < _MIN_RIVAL_VIEWS:
        return found
    start = search_motion(views.select(off), found.cam_from_ref, weights[off], _MIN_RIVAL_VIEWS)
    other = _least_squares(views, weights, start, *views.linearise(start))
    only_other = off & other.accepted
    if not other.ok or only_other.sum() < _MIN_RIVAL_VIEWS:
        return found
    only_found = found.accepted & (other.squared_residuals > _RIVAL_BEYOND * views.gate)
    odds = evidence(views, weights * only_other) / max(evidence(views, weights * only_found), 1e-12)
    if odds > 1 / _RIVAL_SHARE:
        return replace(other, second=SecondMotion(found.cam_from_ref, found.cov_pose, only_found, 1 / odds))
    return replace(found, second=SecondMotion(other.cam_from_ref, other.cov_pose, only_other, odds))


def _robust_fit(views: PointViews, cam_from_ref: Array) -> tuple[Array, Array, Array]:
    """Gauss-Newton with Cauchy weights relative to the spread of the residuals, eq. (22).

    Returns the motion, and roots and Jacobian as `PointViews.linearise` has them.
    """
    root, j = views.linearise(cam_from_ref)
    r, s2 = views.residuals(cam_from_ref, root)
    for k in range(_MAX_ROBUST_STEPS):
        spread = _spread(s2)
        width = spread * (_CAUCHY_WIDTH_FIRST if k < _WIDE_STEPS else _CAUCHY_WIDTH)
        cam_from_ref, moved, _ = _step(cam_from_ref, j, r, 1 / (1 + s2 / width))
        if moved < _ROBUST_CONVERGED and (k >= _WIDE_STEPS - 1 or spread < _SPREAD_SETTLED):
            break
        if (k + 1) % _RELINEARISE_EVERY == 0:
            root, j = views.linearise(cam_from_ref)
        r, s2 = views.residuals(cam_from_ref, root)
    if k >= _RELINEARISE_EVERY:  # fewer steps come from a start that is good enough to be linearised at
        root, j = views.linearise(cam_from_ref)
    return cam_from_ref, root, j


def _least_squares(views: PointViews, weights: Array, cam_from_ref: Array, root: Array, j: Array) -> Resection:
    """Gauss-Newton over the views that pass the gate, eq. (23), which is taken anew after each step."""
    r, s2 = views.residuals(cam_from_ref, root)
    accepted = s2 < views.gate
    for _ in range(_MAX_FINAL_STEPS):
        cam_from_ref, moved, information = _step(cam_from_ref, j, r, accepted.astype(float))
        r, s2 = views.residuals(cam_from_ref, root)
        before, accepted = accepted, s2 < views.gate
        if moved < _FINAL_CONVERGED and (before == accepted).all():
            break
    cov = scaled_inverse(information)
    return Resection(
        cam_from_ref=se3.orthonormalise(cam_from_ref),
        cov_pose=np.full((6, 6), np.inf) if cov is None else cov,
        accepted=accepted,
        chi2=float(s2[accepted].sum()),
        dof=int(views.sides[accepted].sum()) - 6,
        spread=_spread(s2[s2 < _SPREAD_WITHIN * views.gate]),
        ok=cov is not None and bool(accepted.sum() >= MIN_VIEWS),
        squared_residuals=s2,
        share=float(weights[accepted].sum() / max(weights.sum(), 1e-12)),
    )


def _step(cam_from_ref: Array, j: Array, r: Array, weight: Array) -> tuple[Array, float, Array]:
    """Take one weighted Gauss-Newton step: the new pose, the squared length in deviations, the information (6, 6)."""
    weighted = (j * weight[:, None, None]).reshape(-1, 6).T
    h, g = weighted @ j.reshape(-1, 6), weighted @ r.ravel()
    delta = damped_solve(h, g)
    angle = math.sqrt(delta[3:] @ delta[3:])
    if angle > _MAX_ROTATION_STEP_RAD:
        delta *= _MAX_ROTATION_STEP_RAD / angle
    return se3.exp(delta) @ cam_from_ref, float(delta @ h @ delta), h


def _spread(s2: Array) -> float:
    """Return the median of squared residuals over its expected value, at least 1."""
    finite = s2[np.isfinite(s2)]
    return max(1.0, median(finite) / _MEDIAN_CHI2_4) if len(finite) else 1.0
