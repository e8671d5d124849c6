"""The errors of the twists at exposure as unknowns of all frames: six amplitudes of σ = 1 each, eqs. (70b) and (70e).

Twists are derivatives of polynomials through poses. The error of such a polynomial has a known course in time, so few
amplitudes describe it, and later frames make it smaller. Through delay and readout it shifts views.
"""

import numpy as np
from numpy.typing import NDArray

from .... import core
from ....geometry import Array
from ....geometry.linear import scaled_cholesky
from ....record import changed
from ....rig_model.model import RigModel
from ..inverse_depth import State, WhitenedViews
from ..state import WindowState
from .columns import with_effects, with_unknown, without_unknown

TWIST = 6  # amplitudes
_LATE = np.array([0.0, 0.0, 1.0, 0.0])  # coordinates that a delay shifts, as right rows are measured
_AT = slice(-TWIST, None)


def expect_twist(
    current: WindowState,
    rig: RigModel,
    views: WhitenedViews,
    rows: NDArray[np.intp],
    points_in_cam: Array,
    timing: tuple[Array, Array],
    std_change: Array,
) -> tuple[WindowState, WhitenedViews]:
    """Return the state and the next frame's views with the effects of the error of its twist, if that is an unknown.

    That is while it moves views by more than a share of the noise of each, as all of them share it, and if it is known
    in which rows they are exposed. `rows` (n,) of the views see the points (n, 4); the other effects are zero.
    `timing`: delay and readout (2,) s with their covariance; `std_change` (6,): the assumed σ of a change of twists
    between two frames.
    """
    if rig.row_of is None:
        return current, views
    mean, cov = timing
    root = scaled_cholesky(current.exposures.twist_error.cov(std_change, current.prior.rig.rules.least_twist))
    # the effects of delay and readout are not in one ratio while neither is known: of a delay the probable one counts
    size_s = np.array([mean[0], np.copysign(np.hypot(mean[1], np.sqrt(cov[1, 1])), mean[1])])
    current = changed(current, exposures=changed(current.exposures, root=root, size_s=size_s))
    exposures = current.exposures
    errors = np.tile(exposures.errors[-1], (len(rows), 1))
    effects = _effects(current, rig, views.expected_px[rows], points_in_cam, errors)
    matters = (effects**2).sum(axis=2).mean() > current.prior.rig.rules.twist_moves_px**2
    if matters and not exposures.has_twist:
        current = with_unknown(current, current.own.shape[1], TWIST)
    elif not matters and exposures.has_twist and current.first_views is None:
        current = without_unknown(current, _AT)
    else:
        matters = exposures.has_twist
    current = changed(current, exposures=changed(exposures, has_twist=bool(matters)))
    if not matters:
        return current, views
    of_all = np.zeros((len(views), 4, TWIST))
    of_all[rows] = effects
    return current, changed(views, own=np.concatenate([views.own, of_all], axis=2))


def learnt_twists(current: WindowState) -> WindowState:
    """Return the state after its latest twists have shown how much that of a newest frame errs."""
    exposures = current.exposures
    if current.newest_frame.rig is None:
        return current
    indices = [f.index for f in current.all_frames]
    error = exposures.twist_error.after(indices, exposures.motions[:, 0], exposures.errors[-1, 0])
    return changed(current, exposures=changed(exposures, twist_error=error))


def with_twists(current: WindowState, rig: RigModel) -> WindowState:
    """Set the effects of the errors of all twists, which change with each frame that follows."""
    if not current.exposures.has_twist:
        return current
    of_views = _of_views(current, rig, current.state, current.views, first=1)
    current = with_effects(current, slice(None), _AT, of_views)
    if (first := current.first_views) is None:
        return current
    own = first.own.copy()
    own[..., _AT] = _of_views(current, rig, current.of_reference(current.points), first, first=0)
    return changed(current, first_views=changed(first, own=own))


def _of_views(current: WindowState, rig: RigModel, state: State, views: WhitenedViews, first: int) -> Array:
    """Return the effects (V, 4, 6) on the used views of the points; `first`: the frame of exposures of the first."""
    effects, errors = np.zeros((len(views), 4, TWIST)), current.exposures.errors
    errors[:, 0] *= [frame.twist_size for frame in current.all_frames]
    seen = views.used & core.among(views.ids, state.ids)
    in_cam, of_views = core.points_of_views(state, views), errors[first + views.frame[seen]]
    effects[seen] = _effects(current, rig, views.expected_px[seen], in_cam, of_views)
    return effects


def _effects(current: WindowState, rig: RigModel, expected_px: Array, points_in_cam: Array, errors: Array) -> Array:
    """Return the effects (n, 4, 6) px of twists that err by size and bend (n, 2) on views (n, 4) of points (n, 4).

    The front-end has compensated the delay in the right rows, with a twist of its own that errs like that of a newest
    frame. The effect on a missing side is zero.
    """
    exposures, (size, bend) = current.exposures, errors.T[..., None]
    late_s = rig.late_s(expected_px, np.array([0.0, exposures.size_s[1]])) + exposures.size_s[0] * _LATE
    late_s = size * late_s * (1 + bend * late_s)
    late_s[:, 3] += exposures.size_s[0]
    n, unit = len(points_in_cam), np.eye(TWIST)
    by_twist = core.velocities(current.projection, np.repeat(points_in_cam, TWIST, axis=0), np.tile(unit, (n, 1)))
    moved = late_s[:, :, None] * np.swapaxes(by_twist.reshape(n, TWIST, 4), 1, 2)
    moved[~np.isfinite(expected_px)] = 0.0
    return np.asarray(moved @ exposures.root)
