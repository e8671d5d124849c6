"""The focal length as an unknown of each frame, while it changes: how that begins and ends, eqs. (36c) and (72l)."""

import numpy as np
from numpy.typing import NDArray

from ...geometry import Array
from ...geometry.point_views import PointViews
from ...geometry.resection import Resection
from ...record import changed
from ...rig_model.terms import FOCAL, TERMS
from .inverse_depth import WhitenedViews
from .map import Map

_AT = TERMS.index(FOCAL)


def judge_focus(
    current: Map, views: WhitenedViews, rows: NDArray[np.intp], seen: PointViews, weights: Array, found: Resection
) -> tuple[Resection, WhitenedViews]:
    """Return the motion into a frame to come with a focal length of its own, where that changes, and its views.

    `found`: the motion without; `seen`: the `rows` of its views that it was found from, with `weights` (n,).
    """
    columns = _columns(current, views)
    current.focus, motion = current.focus.judge(seen.with_shared(columns[rows]), weights, found)
    if current.focus.has_begun:
        _begin(current)
    if current.has_focus:
        views = changed(views, own=np.concatenate([columns * current.focus.moves, views.own], axis=2))
    return motion, views


def own_at_first(current: Map, motion: Resection) -> Array:
    """Return the amplitudes (1, e) of a frame's own from which the window starts: the focal length of its motion."""
    own = np.zeros((1, current.own.shape[1]))
    if current.focus.moves:
        own[0, 0] = motion.amplitudes[-1]
    return own


def place_focus(current: Map) -> None:
    """Take what the focal length of the newest frame does where its views are expected, as of all errors of the rig.

    Where it is taken at measured places the noise of the views biases it, by little, and the rate at which a focus
    moves, which hardly anything else shows then, by several σ.
    """
    if current.focus.moves:
        _place(current, current.newest)


def end_refocusing(current: Map) -> None:
    """Make a focal length that has changed, and rests, one of the rig's errors again."""
    rests_at = current.focus.rests_at
    if rests_at is not None:
        current.focus = current.focus.calm(rests_at)
        current.change_rig(lambda rig: rig.refocused(rests_at))


def _columns(current: Map, views: WhitenedViews) -> Array:
    """Return what a change of the focal length by σ does to views: (V, 4, 1) px."""
    rules = current.prior.rig.rules
    return np.asarray(views.terms[..., _AT : _AT + 1] * (rules.std_refocused / rules.std_focal))


def _begin(current: Map) -> None:
    """Give each frame of the window a focal length of its own: it may have begun to change before it showed."""
    current.prior = changed(current.prior, rig=changed(current.prior.rig, zooms=True))
    if not current.has_focus:
        current.has_focus = True
        current.own = np.insert(current.own, 0, 0.0, axis=1)
        current.views = changed(current.views, own=np.insert(current.views.own, 0, 0.0, axis=2))
        if (first := current.first_views) is not None:
            current.first_views = changed(first, own=np.insert(first.own, 0, 0.0, axis=2))
            current.prior = current.prior.with_own_of_first(6, 1)
            current.amplitudes = np.insert(current.amplitudes, 6, 0.0)
    _place(current, slice(None))


def _place(current: Map, rows: slice) -> None:
    """Take what the focal length does to some of the window's views as their terms have it."""
    own = current.views.own.copy()
    own[rows, :, :1] = _columns(current, current.views[rows])
    current.views = changed(current.views, own=own)
