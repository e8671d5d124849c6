"""The factor on σ for temporally correlated view errors, measured from halves of the tracks, eq. (69b).

The poses estimated from two halves of the tracks are independent given the modes of the prior. Their difference in
units of its σ needs neither ground truth nor a model of the correlation. Halves are even and odd tracks, and tracks
first seen left and right of the image centre, which show errors that neighbours share. They have all views of the
window's tracks, gated or not, equally weighted, and points that are known from these views alone: whatever was chosen
at the joint minimum, or is known from earlier frames, would draw both halves to the same poses.
"""

from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from .... import core
from ....geometry import Array, se3
from ....geometry.linear import Cholesky, mahalanobis2
from ....geometry.medians import median
from ....record import changed, record
from ..inverse_depth import State, linearise
from ..minimise import without_undetermined
from ..state import WindowState
from .rules import ReportedRules

_TRACE = 1e-6  # share of the prior's information about points, which moves no half by a thousandth of its σ


@record
class SpanFactors:
    """The estimated factors for spans of 1 … b frames.

    `squares` (2, b): means of δᵀC⁻¹δ/6 over the frames so far, of both kinds of halves; `frames` (2, b): the number of
    frames in each mean.
    """

    squares: Array
    frames: Array
    rules: ReportedRules = ReportedRules()

    @classmethod
    def unknown(cls, frames: int, rules: ReportedRules) -> "SpanFactors":
        """Return the first guess for a window of this many frames: errors are not correlated in time."""
        return cls(np.ones((2, frames)), np.full((2, frames), float(rules.halves_guess)), rules)

    @property
    def by_span(self) -> Array:
        """The factors (b,) on σ over 1 … b frames: at least 1, and never decreasing with the span."""
        return np.asarray(np.sqrt(np.maximum.accumulate(np.maximum(self.squares.max(axis=0), 1.0))))

    def asks_for(self, frame_index: int) -> bool:
        """Whether halves are to be compared in this frame; never in a window of one frame."""
        young = self.frames[:, :-1].min(initial=np.inf) < self.rules.halves_memory
        return self.frames.shape[1] > 1 and (bool(young) or frame_index % self.rules.halves_every == 0)

    def after(self, found: Array) -> "SpanFactors":
        """Return the factors after a frame with squares `found` (2, f) over its spans, NaN where there is none."""
        squares, frames = self.squares.copy(), self.frames.copy()
        known = np.zeros(squares.shape, bool)
        known[:, : found.shape[1]] = np.isfinite(found)
        frames[known] = np.minimum(frames[known] + 1, self.rules.halves_memory)
        limited = np.minimum(found[np.isfinite(found)], self.rules.halves_most * squares[known])
        squares[known] += (limited - squares[known]) / frames[known]
        return SpanFactors(squares, frames, self.rules)


def squares_of_halves(of: WindowState, rules: ReportedRules) -> Array:
    """Return δᵀC⁻¹δ/6 (2, f) over spans of 1 … f frames, of both kinds of halves.

    NaN if a half does not determine the poses, and for the last span: no view of the window is of the reference camera.
    """
    alone = _unselected(of, rules.halves_within)
    found = np.full((2, len(of.frames)), np.nan)
    from_newest = of.cams_from_ref[:-1] @ se3.inverse(of.cams_from_ref[-1])
    with suppress(np.linalg.LinAlgError):
        parts = _poses_by(alone, _quarters(alone, alone.state, rules.halves_least), 4)
        for kind, (first, second) in enumerate(((0, 1), (0, 2))):  # quarters of even tracks, and of those on the left
            third, fourth = (k for k in range(4) if k not in (first, second))
            with suppress(np.linalg.LinAlgError):
                halves = _together(parts[first], parts[second]), _together(parts[third], parts[fourth])
                found[kind, :-1] = _squares(from_newest, *halves)[:-1]
    return found


def _unselected(of: WindowState, most: float) -> WindowState:
    """Return the map with all views of its points, equally weighted, but gross mismatches: those beyond `most` σ²."""
    views = changed(of.views, used=np.ones(len(of.views), bool))
    near = core.views_within_gates(of.projection, of.state, views, views.var_drift, most, most)
    root, weight = views.root / views.weight[:, None, :], np.ones_like(views.weight)
    return without_undetermined(changed(of, views=changed(views, used=near, root=root, weight=weight)))


def _together(one: tuple[Array, Array], other: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the sums of information and right-hand sides."""
    return one[0] + other[0], one[1] + other[1]


def _quarters(of: WindowState, at: State, least: float) -> NDArray[np.int64]:
    """Return the quarter of each point (P,): even on the left, even on the right, odd on the left, odd on the right.

    The side is that in the point's anchor, the camera that first saw it. If all tracks but a share `least` have even
    or odd numbers, or come from one side of the image, the halves are made by their order or by the median.
    """
    p, x = of.projection, at.q[:, 0]
    odd, right = at.ids % 2 == 1, p.f_px * x + p.cx_left_px > p.width / 2
    if not least < odd.mean() < 1 - least:
        odd = np.arange(len(x)) % 2 == 1
    if not least < right.mean() < 1 - least:
        right = x > median(x)
    return 2 * odd.astype(np.int64) + right


def _poses_by(of: WindowState, parts_of: NDArray[np.int64], parts: int) -> list[tuple[Array, Array]]:
    """Return the normal equations of the poses by parts of the points, given all else: (n, n) and (n,) each."""
    at, frames = of.state, len(of.frames)
    blocks = linearise(of.projection, at, of.views, with_rig=False)
    # a trace of what is known from earlier frames: points that no stereo view of the window shows have depths
    blocks.v[np.searchsorted(of.points.ids, of.prior.ids)] += _TRACE * np.linalg.inv(of.prior.cov)
    by_pose = blocks.w.reshape(*blocks.w.shape[:2], frames, -1)[..., :6].reshape(-1, 3, 6 * frames)
    _, reach = core.eliminate_points(blocks.v, np.concatenate([by_pose, blocks.g_point[..., None]], axis=2))
    found = core.poses_by_parts(of.projection, at, of.views, reach, reach[..., -1], parts_of, parts)
    return list(zip(*found, strict=True))


def _apart_from_newest(from_newest: Array, of_poses: Array) -> Array:
    """Return J of eq. (74) times a matrix (6F, n), for the reference and every camera of F but the newest.

    `from_newest` (F − 1, 4, 4): the motions from the newest camera to these cameras, without the reference.
    """
    moved = se3.adjoint(se3.inverse(from_newest))
    by_pose = of_poses.reshape(len(moved) + 1, 6, -1)
    return np.concatenate([-by_pose[-1:], moved @ by_pose[:-1] - by_pose[-1]])


def _squares(from_newest: Array, one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Return δᵀC⁻¹δ/6 (f,) from the information and right-hand sides of two halves; shortest span first."""
    roots = [Cholesky(information, repair=False).root for information, _ in (one, other)]
    steps = [root @ (root.T @ right) for root, (_, right) in zip(roots, (one, other), strict=True)]
    apart = _apart_from_newest(from_newest, np.column_stack([*roots, steps[0] - steps[1]]))
    cov = apart[..., :-1] @ np.swapaxes(apart[..., :-1], 1, 2)
    return mahalanobis2(apart[..., -1], cov)[::-1] / 6
