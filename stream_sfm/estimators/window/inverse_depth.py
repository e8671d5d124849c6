"""Points as q = (X/Z, Y/Z, 1/Z) in the camera that first saw them, and the linearised stereo views of many frames.

In these coordinates a stereo view is nearly linear, so a Gaussian over q stays valid for far points. Points at
infinity, and points beside or behind the current camera, need no special treatment. The camera that first saw a point
is its anchor. Homogeneous points in the reference camera are C (q₁, q₂, 1, q₃)ᵀ with C = ref_from_anchor, eq. (24). C
counts as known: it is a choice of coordinates and not part of the state. A frame s with pose X_s = cam_s_from_ref sees
P = X_s C (q₁, q₂, 1, q₃)ᵀ. A pose is perturbed as Exp(ξ) X_s (left), which is the right perturbation −ξ of
ref_from_cam_s. Arrays are batched: F frames, P points, V views.
"""

from operator import attrgetter
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...geometry import Array
from ...geometry.stereo import StereoProjection
from ...geometry.view_stages import CorrectedViews
from ...record import changed, columns_at, record
from ...rig_model.model import FIELD_MOVES, RigModel
from ...rig_model.terms import AT_TIMING


def q_of_views(projection: StereoProjection, z_px: CorrectedViews) -> Array:
    """Return q (n, 3) of stereo views (n, 4) in their camera; the image row is the mean of both."""
    v = 0.5 * (z_px[:, 1] + z_px[:, 3])
    x, y = (z_px[:, 0] - projection.cx_left_px) / projection.f_px, (v - projection.cy_px) / projection.f_px
    return np.stack([x, y, projection.inverse_depth(z_px)], axis=1)


class State(NamedTuple):
    """The state that views are predicted from: poses `cams_from_ref` (F, 4, 4), points (P,) and `rig_error` (m,).

    Points have `ids`, which are ascending, `ref_from_anchor` (P, 4, 4) and `q` (P, 3). `own` (F, e): amplitudes of the
    errors that the views of each frame share.
    """

    cams_from_ref: Array
    ids: NDArray[np.int64]
    ref_from_anchor: Array
    q: Array
    rig_error: Array
    own: Array = np.zeros((0, 0))


@record
class WhitenedViews:
    """Views of one or several frames, as rows sorted by frame and then by id.

    `frame` (V,): row of the frame, from 0; `ids` (V,): of the points, each pair at most once; `z_px` (V, 4): finite.
    `root` (V, 4, 4) whitens a residual, with temporally correlated errors counted once per track: RᵀR is the
    information that counts, with zero rows for a missing side. `weight` (V, 4): the square root of its share in the
    view's own information, per coordinate; 1 if errors are independent. `used` (V,) bool: which views count; `stereo`
    (V,) bool: both sides were seen. `expected_px` (V, 4): where used views were expected before they counted, or an
    earlier place of their track if it has hardly moved since; the rig's errors are evaluated there. `var_drift` (V, 3):
    variance of the drift of q since the previous frame. `own` (V, 4, e), px: effect of the errors that the views of a
    frame share, at amplitudes of σ = 1. Effects of the rig's errors at amplitudes of 1, px: `terms` (V, 4, t); `timing`
    (V, 4, 2), which is added to those of delay and readout and renewed with the velocities, or (V, 4, 0); and `field`
    (V, K), the field's basis.
    """

    frame: NDArray[np.intp]
    ids: NDArray[np.int64]
    z_px: Array
    root: Array
    weight: Array
    used: NDArray[np.bool_]
    stereo: NDArray[np.bool_]
    expected_px: Array
    var_drift: Array
    own: Array
    terms: Array
    timing: Array
    field: Array
    moves: ClassVar[Array] = FIELD_MOVES  # by parts of the field

    def with_newest(self, rows: NDArray[np.intp], newest: "WhitenedViews") -> "WhitenedViews":
        """Return some rows of these views, followed by those of the newest frame."""
        columns: list[Any] = []
        for before, new in zip(_COLUMNS(self), _COLUMNS(newest), strict=True):
            column = np.empty((len(rows) + len(new), *new.shape[1:]), new.dtype)
            before.take(rows, axis=0, out=column[: len(rows)], mode="clip")  # "raise" would copy once more
            column[len(rows) :] = new
            columns.append(column)
        return WhitenedViews(*columns)

    def __len__(self) -> int:
        return len(self.ids)

    def __getitem__(self, rows: slice | NDArray[np.intp]) -> "WhitenedViews":
        return WhitenedViews(*columns_at(_COLUMNS(self), rows))

    def shift_px(self, amplitudes: Array) -> Array:
        """Return the shifts (V, 4) of the views by amplitudes (m,) of the rig's errors."""
        own, timed = self.terms.shape[2], self.timing.shape[2]
        parts = amplitudes[own:].reshape(FIELD_MOVES.shape[1], -1)
        of_terms = (self.terms.reshape(-1, own) @ amplitudes[:own]).reshape(-1, 4)
        of_timing = self.timing @ amplitudes[AT_TIMING][:timed]
        return np.asarray(of_terms + of_timing + self.field @ parts.T @ FIELD_MOVES.T)


_COLUMNS = attrgetter(*WhitenedViews.__match_args__)


def expected(state: State, views: WhitenedViews, rig: RigModel) -> WhitenedViews:
    """Return the views, with `expected_px` of the used ones set to their predictions."""
    expected_px = core.expected_views(rig.projection, state, views, views.stereo, views.expected_px)
    return changed(views, expected_px=expected_px)


def held(views: WhitenedViews, ids: NDArray[np.int64], places_px: Array, rests_px: float) -> WhitenedViews:
    """Return the views with `expected_px` kept at `places_px` (n, 4) of tracks `ids` (n,), ascending, that rest.

    A track rests if it has moved by less than `rests_px`. Expected places contain the noise of their points. In a
    camera at rest, the effects of the rig's errors would differ between views by this noise alone, and it would seem to
    show these errors, eq. (72i).
    """
    if not len(ids):
        return views
    at = np.minimum(np.searchsorted(ids, views.ids), len(ids) - 1)
    before_px = places_px[at]
    moved_px = np.abs(before_px - views.expected_px)
    moved_px[np.isnan(views.expected_px)] = 0.0  # this side is missing now
    rests = (ids[at] == views.ids) & (moved_px.max(axis=1) < rests_px)  # NaN, so false, if a side was missing then
    return changed(
        views, expected_px=np.where(rests[:, None] & ~np.isnan(views.expected_px), before_px, views.expected_px)
    )


def at_rest(views: WhitenedViews, rig: RigModel, age_s: Array | float) -> WhitenedViews:
    """Return the views with the effects of the rig's errors at their expected places, without those of motion.

    `age_s`: the time for which the errors have grown, one for all views or (V,).
    """
    terms, field = rig.at_rest(views.expected_px, age_s)
    return changed(views, terms=terms, field=field)


def timed(state: State, views: WhitenedViews, rig: RigModel, motions: Array, timing_s: Array) -> WhitenedViews:
    """Return the views with the effects of delay and readout at their expected places; `motions` (F, 2, 6) of frames.

    The effects are exact to second order near a delay and readout `timing_s` (2,).
    """
    if rig.row_of is None:
        return views
    by_second = core.timing_of_views(*rig.cameras, state, views, views.expected_px, motions, timing_s)
    return changed(views, timing=by_second * rig.units_of_timing)


def linearise(
    projection: StereoProjection, state: State, views: WhitenedViews, with_rig: bool = True
) -> core.NormalBlocks:
    """Return the Gauss-Newton normal equations of all used views of the points, eqs. (25), (26) and (71).

    Views of other points are ignored. Without `with_rig` the rig's errors are not among the unknowns.
    """
    return core.normal_blocks(projection, state, views, with_rig)


def points_alone(
    projection: StereoProjection, views: WhitenedViews, state: State, rig_step: Array
) -> tuple[Array, Array, Array, Array]:
    """Return the points of a state estimated from views of the reference camera alone; see `core.points_alone`."""
    blocks = linearise(projection, state, views)
    return core.points_alone(blocks.v, blocks.w, blocks.g_point, blocks.rig_point, state.q, rig_step)
