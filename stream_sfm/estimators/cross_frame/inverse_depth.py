"""Points as q = (X/Z, Y/Z, 1/Z) in the camera that first saw them, and the linearised stereo views of many frames.

In these coordinates a stereo view is nearly linear, so a Gaussian over q stays valid for far points, a point at
infinity is an ordinary one, and so is a point beside or behind the current camera. The camera that first saw a point is
its anchor. Homogeneous points in the reference camera are C (q₁, q₂, 1, q₃)ᵀ with C = ref_from_anchor, eq. (24): a
known pose, a choice of coordinates and not part of the state. A frame s with pose X_s = cam_s_from_ref sees
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
from ...record import changed, columns_at, record
from ...rig_model.model import FIELD_MOVES, RigModel
from ...rig_model.terms import AT_TIMING


def q_of_views(projection: StereoProjection, z_px: Array) -> Array:
    """Return q (n, 3) of stereo views (n, 4) in the camera that saw them; the row is the mean of both."""
    v = 0.5 * (z_px[:, 1] + z_px[:, 3])
    x, y = (z_px[:, 0] - projection.cx_left_px) / projection.f_px, (v - projection.cy_px) / projection.f_px
    return np.stack([x, y, projection.inverse_depth(z_px)], axis=1)


class State(NamedTuple):
    """What views are predicted from: poses `cams_from_ref` (F, 4, 4), points (P,) and `rig_error` (m,) of the rig.

    Of the points `ids`, which are ascending, `ref_from_anchor` (P, 4, 4) and `q` (P, 3). `own` (F, e): amplitudes of
    what each frame's views err by in common.
    """

    cams_from_ref: Array
    ids: NDArray[np.int64]
    ref_from_anchor: Array
    q: Array
    rig_error: Array
    own: Array = np.zeros((0, 0))


@record
class WhitenedViews:
    """Views of one frame or of several, as rows in the order of frames, and of ids in each of them.

    `frame` (V,): row of the frame, from 0; `ids` (V,): of the points, each pair at most once; `z_px` (V, 4) finite;
    `root` (V, 4, 4) whitens a residual, as one of its track, in which errors that last are counted once: RᵀR is the
    information that counts, with zero rows for a side that is missing. `weight` (V, 4): the square root of its
    share in what the view itself has, coordinate by coordinate; 1 where errors are independent. `used` (V,) bool:
    which views count; `stereo` (V,) bool: both sides were seen. `expected_px` (V, 4): where the used views were
    expected before they counted, or where their tracks have hardly left; there the rig's errors are taken.
    `var_drift` (V, 3): drift of q since the frame before. What amplitudes of σ = 1 that each frame has of its own
    do, px: `own` (V, 4, e). What amplitudes of 1 of the rig's errors do, px: `terms` (V, 4, t); `timing` (V, 4, 2),
    which is added to those of delay and readout, as it is renewed with the velocities, or (V, 4, 0); and the
    field's basis, `field` (V, K).
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
        """Return what amplitudes (m,) of the rig's errors do (V, 4)."""
        own, timed = self.terms.shape[2], self.timing.shape[2]
        parts = amplitudes[own:].reshape(FIELD_MOVES.shape[1], -1)
        of_terms = (self.terms.reshape(-1, own) @ amplitudes[:own]).reshape(-1, 4)
        of_timing = self.timing @ amplitudes[AT_TIMING][:timed]
        return np.asarray(of_terms + of_timing + self.field @ parts.T @ FIELD_MOVES.T)


_COLUMNS = attrgetter(*WhitenedViews.__match_args__)


def expected(state: State, views: WhitenedViews, rig: RigModel) -> WhitenedViews:
    """Return views with the used ones placed where they are expected."""
    expected_px = core.expected_views(rig.projection, state, views, views.stereo, views.expected_px)
    return changed(views, expected_px=expected_px)


def held(views: WhitenedViews, ids: NDArray[np.int64], places_px: Array, rests_px: float) -> WhitenedViews:
    """Return views placed where tracks `ids` (n,), ascending, were, (n, 4), if they have moved by less since.

    Expected places err by the noise of their points. Where a camera rests that noise would be all by which errors of
    the rig differ between views, and show them, (72i).
    """
    if not len(ids):
        return views
    at = np.minimum(np.searchsorted(ids, views.ids), len(ids) - 1)
    before_px = places_px[at]
    moved_px = np.abs(before_px - views.expected_px)
    moved_px[np.isnan(views.expected_px)] = 0.0  # a side that is missing now
    rests = (ids[at] == views.ids) & (moved_px.max(axis=1) < rests_px)  # not where a side was missing then: NaN
    return changed(
        views, expected_px=np.where(rests[:, None] & ~np.isnan(views.expected_px), before_px, views.expected_px)
    )


def at_rest(views: WhitenedViews, rig: RigModel, age_s: Array | float) -> WhitenedViews:
    """Return views with what errors of the rig that stands still do at their places.

    `age_s`, or one (V,) each: for how long these have grown.
    """
    terms, field = rig.at_rest(views.expected_px, age_s)
    return changed(views, terms=terms, field=field)


def timed(state: State, views: WhitenedViews, rig: RigModel, motions: Array, timing_s: Array) -> WhitenedViews:
    """Return views with what delay and readout do to them where they were expected, with `motions` (F, 2, 6) of frames.

    Exact to second order near a delay and readout `timing_s` (2,).
    """
    if rig.row_of is None:
        return views
    by_second = core.timing_of_views(*rig.cameras, state, views, views.expected_px, motions, timing_s)
    return changed(views, timing=by_second * rig.units_of_timing)


def linearise(
    projection: StereoProjection, state: State, views: WhitenedViews, with_rig: bool = True
) -> core.NormalBlocks:
    """Return the Gauss-Newton normal equations of all used views of the points, eqs. (25), (26) and (71).

    Views of other points are left out. Without `with_rig` the rig's errors are not among the unknowns.
    """
    return core.normal_blocks(projection, state, views, with_rig)
