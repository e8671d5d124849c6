"""Robust resection: the motion of a stereo camera from points with covariances and their stereo views.

Every estimator starts a frame from it, and the front-end uses its outlier test. Cauchy weights come first, wide and
then narrow; then a χ² gate and plain least squares over the accepted views, so that the covariance is that of
Gaussian noise. If too few views agree with the result from a start, the whole space of motions is searched
(`core/search.cpp`), and so is a second motion that the other views have in common.
"""

from dataclasses import field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..record import changed, filled, record
from . import se3
from .point_views import ROBUST, PointViews
from .se3 import Array

# At least twelve coordinates, twice the unknowns, even if every view lacks its right side.
MIN_VIEWS = core.MIN_VIEWS
MANY_VIEWS = 2 * MIN_VIEWS  # fewer agree by chance


class Wanted(NamedTuple):
    """Whether to look for a `second` motion, what is known about the start, and whether to `search` in any case."""

    second: bool
    start_is_close: bool
    start_is_decided: bool
    search: bool


@record
class SecondMotion:
    """A second motion, `cam_from_ref` (4, 4), of views that clearly disagree with the first one.

    `cov_pose` (6, 6): of ref_from_cam, right perturbation. `views` (n,) bool: those that agree only with this motion;
    `odds`: their evidence over that of the views that agree only with the first motion. `in_front`: whether these
    views are in front of those of the first motion, and so on a moving body.
    """

    cam_from_ref: Array
    cov_pose: Array
    views: NDArray[np.bool_]
    odds: float
    in_front: bool = False


@record
class Resection:
    """The motion that brings points onto their views.

    `cam_from_ref` (4, 4); `cov_pose` (6, 6): of ref_from_cam, right perturbation; `accepted` (n,) bool; `chi2` and
    `dof` of the accepted views; `spread`: median squared residual of the views that may belong to the motion over
    its expected value, at least 1; `ok`: there are enough accepted views, and they determine the motion.
    `squared_residuals` (n,): of all views, whitened. `share`: share of the weight in the accepted views; `second`:
    the motion of others. `amplitudes` (j,) of the shared errors, with `cov_amplitudes` (j, j). `ambiguous_share`:
    odds from which the second motion makes the first one ambiguous.
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
    amplitudes: Array = field(default_factory=lambda: np.zeros(0))
    cov_amplitudes: Array = field(default_factory=lambda: np.zeros((0, 0)))
    second: SecondMotion | None = None
    ambiguous_share: float = ROBUST.ambiguous_share

    @property
    def ambiguous(self) -> SecondMotion | None:
        """The second motion if the views do not show which of the two is that of the background."""
        return self.second if self.second and self.second.odds >= self.ambiguous_share else None


def resect(
    views: PointViews,
    cam_from_ref_start: Array,
    weights: Array | None = None,
    predicted: Array | None = None,
    find_second: bool = True,
    start_is_close: bool = False,
    start_is_decided: bool = False,
    search: bool = False,
    amplitudes: Array | None = None,
) -> Resection:
    """Find the motion `cam_from_ref` that brings points onto their views (n), eqs. (20)–(23), from a start (4, 4).

    Errors that the views share are estimated with it. `weights` (n,): the votes of the views if sets of views have
    different motions (None: all equal); among the views of one motion only their noise counts. With a `predicted`
    motion (4, 4), the motion is that of one rigid scene: if a body and the background agree with a motion between
    theirs, each view within its noise, halves of the views disagree, and the motion is sought again. `find_second`:
    look for a second motion. `start_is_close`: the start is already the best motion, on which most views agree; if
    nearly all of them do, neither another start nor annealing is needed. `start_is_decided`: do not look for
    motions of other views. `search`: search the whole space of motions, however many views agree with the result
    from the start. `amplitudes` (j,): of the shared errors at the start (None: zero).
    """
    n, settings = len(views), views.settings
    if n < MIN_VIEWS:
        unknown = np.full((6, 6), np.inf)
        return Resection(cam_from_ref_start, unknown, np.zeros(n, bool), 0.0, 0, 1.0, False, np.full(n, np.inf))
    weights = np.ones(n) if weights is None else weights
    wanted = Wanted(find_second, start_is_close, start_is_decided, search)
    amplitudes = np.zeros(views.shared.shape[2]) if amplitudes is None else amplitudes
    found, second = core.resect(views, cam_from_ref_start, amplitudes, weights, settings, wanted, predicted)
    other = None if second is None else filled(SecondMotion, second)
    return filled(Resection, found, second=other, ambiguous_share=settings.ambiguous_share)


def refine(views: PointViews, weights: Array, cam_from_ref: Array, amplitudes: Array) -> Resection:
    """Find the motion of the views that agree with one (4, 4), which is close to theirs, eq. (23)."""
    found = core.fit_motion(views, cam_from_ref, amplitudes, weights, views.settings, False)  # without annealing
    return filled(Resection, found, ambiguous_share=views.settings.ambiguous_share)


def combined(found: Resection, other_from_ref: Array, cov_other: Array) -> Resection:
    """Return the combination of a motion with another one (4, 4) with its covariance (6, 6), eq. (23e)."""
    cov = found.cov_pose
    gain = np.linalg.solve(cov + cov_other, cov).T
    back = se3.log(found.cam_from_ref @ se3.inverse(other_from_ref))
    cam_from_ref = se3.exp(-gain @ back) @ found.cam_from_ref
    return changed(found, cam_from_ref=cam_from_ref, cov_pose=cov - gain @ cov)


def judged(found: Resection, views: PointViews, weights: Array) -> Resection:
    """Return a motion of some of the views (n) judged by all of them: which agree with it unchanged."""
    squared = residuals_of(views, found.cam_from_ref, found.amplitudes)
    accepted = squared < views.gate
    return changed(
        found,
        accepted=accepted,
        squared_residuals=squared,
        chi2=float(squared[accepted].sum()),
        dof=int(np.isfinite(views.z_px[accepted]).sum()),
        share=float(weights[accepted].sum() / weights.sum()),
    )


def residuals_of(views: PointViews, cam_from_ref: Array, amplitudes: Array | None = None) -> Array:
    """Return the squared whitened residuals (n,) of views under a motion (4, 4), with amplitudes (j,) or without."""
    root, _ = views.linearise(cam_from_ref)
    return views.squared_residuals(cam_from_ref, root, amplitudes)
