"""Robust resection: the motion of a stereo camera from points with covariances and their stereo views.

Every estimator starts a frame from it, and the front-end takes its outlier test from it. Cauchy weights come first,
wide and then narrow; then a χ² gate and plain least squares over the accepted views, so that the covariance is that of
Gaussian noise. Where too few views agree with what a start led to, the whole space of motions is searched
(`motion_search.py`), and it is looked whether the views that disagree have another motion in common.
"""

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import core
from . import se3
from .linear import scaled_inverse
from .medians import CAUCHY_WIDTH, MEDIAN_CHI2_4, median
from .motion_search import evidence, search_motion, support
from .point_views import PointViews
from .se3 import MAX_ROTATION_STEP_RAD, Array
from .stereo import StereoProjection

MIN_VIEWS = 6  # twelve coordinates at least, twice the unknowns, even where every view lacks its right side
_FIRST_CAUCHY_WIDTH2 = 6.0  # a little wider while the motion is still moving fast: fewer good views are let go of
_WIDE_STEPS = 3
_MAX_ROBUST_STEPS = 9
_MAX_FINAL_STEPS = 4
_RELINEARISE_EVERY = 3  # steps: between them the pose moves too little to change the Jacobian much
# Squared length of a step in standard deviations of the motion, below which iterating stops.
_ROBUST_CONVERGED = 0.3  # half a standard deviation; the final least squares does the rest
_FINAL_CONVERGED = 1e-2  # a tenth of a standard deviation
_SPREAD_SETTLED = 2.0  # residuals this close to their expected size: the first step may already be the last
# The global search costs a few ms: it is made where less of the weight than this agrees with the motion found. Calm
# frames of the sample logs accept more than 0.85. (Where all squared residuals are twice too large 0.94 are accepted,
# where they are four times too large 0.67.)
_CALM_SHARE = 0.8
# From a close start noise may be twice what was assumed before the search is made: a drone that is shaken has squared
# residuals of up to 3.3 times their expected size, and 12 ms of a frame's 30 went into searches that found nothing.
_CALM_SPREAD = 4.0
_SPREAD_WITHIN = 10.0  # gates: views further off belong to something else and say nothing about the noise
# A second motion makes the first one ambiguous from this share of the evidence of the first one on. Bodies that
# pass in a room have up to .05 of it on the sample logs, and up to .09 where they are there before anything has a
# history.
_AMBIGUOUS_SHARE = 0.1
BEYOND = 2.0  # gates: views that are clearly not of the first motion
MIN_SECOND_VIEWS = 8  # two determine a motion; six more do not agree with it by chance


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
    def is_ambiguous(self) -> bool:
        """Whether the views cannot tell which of the two motions is that of the background."""
        return self.odds >= _AMBIGUOUS_SHARE


@dataclass(frozen=True, slots=True)
class Resection:
    """The motion that brings points onto their views.

    `cam_from_ref` (4, 4); `cov_pose` (6, 6): of ref_from_cam, right perturbation; `accepted` (n,) bool; `chi2` and
    `dof` of the accepted views; `spread`: median squared residual of the views that may belong to the motion over its
    expected value, at least 1; `ok`: enough accepted views, and they determine the motion. `squared_residuals` (n,): of
    all views, whitened. `share`: of the weight that the accepted views have; `second`: what others agree on.
    `amplitudes` (j,) of the shared errors, with `cov_amplitudes` (j, j).
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
    amplitudes: Array = field(default_factory=lambda: np.zeros(0))
    cov_amplitudes: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def ambiguous(self) -> SecondMotion | None:
        """The second motion where the views cannot tell which of the two is that of the background."""
        return self.second if self.second and self.second.is_ambiguous else None


class _Motion(NamedTuple):
    """A motion `cam_from_ref` (4, 4), and the `amplitudes` (j,) of errors that all views share."""

    cam_from_ref: Array
    amplitudes: Array


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
    shared: Array | None = None,
    start_is_decided: bool = False,
) -> Resection:
    """Find the motion `cam_from_ref` that brings points onto their views, eqs. (20)–(23).

    `points_in_ref` (n, 3) metres or (n, 4) homogeneous, `cov_points` of the same dimension (None: exact),
    `z_px` (n, 4) with NaN where the right side is missing, `cov_px` (n, 4, 4), start (4, 4). `weights` (n,): how much
    each view counts where sets of views vote for different motions (None: all the same); among the views of one motion
    only their noise counts. `start_is_close`: the start is already a motion that most of these views agree on, the best
    of any; where nearly all of them do, neither another start nor annealing is needed. `find_second`: whether a second
    motion is looked for. `shared` (n, 4, j): what errors of σ = 1 that all views share do to them; they are estimated
    with the motion. `start_is_decided`: no motion of other views is looked for.
    """
    n = len(z_px)
    if n < MIN_VIEWS:
        unknown = np.full((6, 6), np.inf)
        return Resection(cam_from_ref_start, unknown, np.zeros(n, bool), 0.0, 0, 1.0, False, np.full(n, np.inf))
    if points_in_ref.shape[-1] == 3:
        points_in_ref, cov_points = homogeneous(points_in_ref, cov_points)
    views = PointViews(projection, points_in_ref, cov_points, z_px, cov_px, gate_probability, shared)
    weights = np.ones(len(views)) if weights is None else weights
    start = _Motion(cam_from_ref_start, np.zeros(views.shared.shape[2]))
    if start_is_close:
        found = _least_squares(views, weights, start, *views.linearise(cam_from_ref_start))
        if found.ok and (start_is_decided or _agrees_with_nearly_all(views, found, weights)):
            return found
    found = _solve(views, start, weights)
    if found.share < _CALM_SHARE:
        other = _search(views, start, weights)
        if other.ok and _support(views, other, weights) > _support(views, found, weights):
            found = other
    return _with_second_motion(views, found, weights) if find_second else found


def _solve(views: PointViews, start: _Motion, weights: Array) -> Resection:
    """Anneal Cauchy weights, gate, and finish with plain least squares over the accepted views."""
    return _least_squares(views, weights, *_robust_fit(views, start))


def _agrees_with_nearly_all(views: PointViews, found: Resection, weights: Array) -> bool:
    """Whether nearly all views agree with the motion, if their noise is as large as their median residual says."""
    agree = found.squared_residuals < min(found.spread, _CALM_SPREAD) * views.gate
    return bool(weights[agree].sum() >= _CALM_SHARE * weights.sum())


def _search(views: PointViews, start: _Motion, weights: Array) -> Resection:
    """Search for the motion of largest support, and finish it with plain least squares.

    No annealing: among many views that move together even small weights would lead away from it.
    """
    motion = search_motion(views, start.cam_from_ref, weights)
    return _least_squares(views, weights, _Motion(motion, start.amplitudes), *views.linearise(motion))


def refine(views: PointViews, weights: Array, cam_from_ref: Array, amplitudes: Array) -> Resection:
    """Find the motion of the views that agree with one (4, 4), which is close to theirs."""
    return _least_squares(views, weights, _Motion(cam_from_ref, amplitudes), *views.linearise(cam_from_ref))


def _support(views: PointViews, found: Resection, weights: Array) -> float:
    """Return the support of one motion, whitened where it is."""
    root, _ = views.linearise(found.cam_from_ref)
    return float(support(views.without_shared(found.amplitudes), found.cam_from_ref[None], root, weights)[0])


def _with_second_motion(views: PointViews, found: Resection, weights: Array) -> Resection:
    """Add the motion that the views which clearly disagree have in common, or exchange the two where that is clear.

    Many views may agree with both motions; they say nothing about which of the two is that of the background.
    A view has three coordinates of its own: it takes so many more where it also determines errors that all share.
    """
    off = found.squared_residuals > BEYOND * views.gate
    if not found.ok or off.sum() < MIN_SECOND_VIEWS:
        return found
    seen = views.without_shared(found.amplitudes)
    start = search_motion(seen.select(off), found.cam_from_ref, weights[off], MIN_SECOND_VIEWS)
    other = _least_squares(views, weights, _Motion(start, found.amplitudes), *views.linearise(start))
    only_other = off & other.accepted
    determined = len(other.amplitudes) - float(np.trace(other.cov_amplitudes))
    if not other.ok or only_other.sum() < MIN_SECOND_VIEWS + determined / 3:
        return found
    only_found = found.accepted & (other.squared_residuals > BEYOND * views.gate)
    odds = evidence(views, weights * only_other) / max(evidence(views, weights * only_found), 1e-12)
    if odds > 1 / _AMBIGUOUS_SHARE:
        second = SecondMotion(found.cam_from_ref, found.cov_pose, only_found, 1 / odds)
        return replace(other, second=second)
    return replace(found, second=SecondMotion(other.cam_from_ref, other.cov_pose, only_other, odds))


def _robust_fit(views: PointViews, at: _Motion) -> tuple[_Motion, Array, Array]:
    """Gauss-Newton with Cauchy weights relative to the spread of the residuals, eq. (22).

    Returns the motion, and roots and Jacobian as `PointViews.linearise` has them.
    """
    root, j = views.linearise(at.cam_from_ref)
    r, s2 = views.residuals(at.cam_from_ref, root, at.amplitudes)
    for k in range(_MAX_ROBUST_STEPS):
        spread = _spread(s2)
        width = spread * (_FIRST_CAUCHY_WIDTH2 if k < _WIDE_STEPS else CAUCHY_WIDTH**2)
        at, moved, _ = _step(at, j, r, 1 / (1 + s2 / width))
        if moved < _ROBUST_CONVERGED and (k >= _WIDE_STEPS - 1 or spread < _SPREAD_SETTLED):
            break
        if (k + 1) % _RELINEARISE_EVERY == 0:
            root, j = views.linearise(at.cam_from_ref)
        r, s2 = views.residuals(at.cam_from_ref, root, at.amplitudes)
    if k >= _RELINEARISE_EVERY:  # fewer steps come from a start that is good enough to be linearised at
        root, j = views.linearise(at.cam_from_ref)
    return at, root, j


def _least_squares(views: PointViews, weights: Array, at: _Motion, root: Array, j: Array) -> Resection:
    """Gauss-Newton over the views that pass the gate, eq. (23), which is taken anew after each step."""
    r, s2 = views.residuals(at.cam_from_ref, root, at.amplitudes)
    accepted = s2 < views.gate
    for _ in range(_MAX_FINAL_STEPS):
        at, moved, information = _step(at, j, r, accepted.astype(float))
        r, s2 = views.residuals(at.cam_from_ref, root, at.amplitudes)
        before, accepted = accepted, s2 < views.gate
        if moved < _FINAL_CONVERGED and (before == accepted).all():
            break
    cov = scaled_inverse(information)
    return Resection(
        cam_from_ref=se3.orthonormalise(at.cam_from_ref),
        cov_pose=np.full((6, 6), np.inf) if cov is None else cov[:6, :6],
        accepted=accepted,
        chi2=float(s2[accepted].sum()),
        dof=int(views.sides[accepted].sum()) - 6,
        spread=_spread(s2[s2 < _SPREAD_WITHIN * views.gate]),
        ok=cov is not None and bool(accepted.sum() >= MIN_VIEWS),
        squared_residuals=s2,
        share=float(weights[accepted].sum() / max(weights.sum(), 1e-12)),
        amplitudes=at.amplitudes,
        cov_amplitudes=np.eye(len(at.amplitudes)) if cov is None else cov[6:, 6:],
    )


def _step(at: _Motion, j: Array, r: Array, weight: Array) -> tuple[_Motion, float, Array]:
    """Take one weighted Gauss-Newton step.

    Returns the motion, the squared length of the step in deviations, and the information (6 + j, 6 + j).
    """
    delta, h = core.motion_step(j, r, weight, at.amplitudes)
    angle = math.sqrt(delta[3:6] @ delta[3:6])
    if angle > MAX_ROTATION_STEP_RAD:
        delta *= MAX_ROTATION_STEP_RAD / angle
    moved = _Motion(se3.exp(delta[:6]) @ at.cam_from_ref, at.amplitudes + delta[6:])
    return moved, float(delta @ h @ delta), h


def _spread(s2: Array) -> float:
    """Return the median of squared residuals over its expected value, at least 1."""
    finite = s2[np.isfinite(s2)]
    return max(1.0, median(finite) / MEDIAN_CHI2_4) if len(finite) else 1.0
