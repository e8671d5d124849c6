"""The focal length of a frame as one of the frame's own unknowns: what it does to views, eq. (36c)."""

import numpy as np

from ...geometry.se3 import Array
from ...record import changed
from ...rig_model.model import RigModel
from ...rig_model.terms import FOCAL, TERMS
from .inverse_depth import WhitenedViews
from .map import Map

_AT = TERMS.index(FOCAL)


def focus_columns(current: Map, model: RigModel, terms: Array) -> Array:
    """Return what a change of the focal length by σ does to views with `terms` (n, 4, t): (n, 4, 1) px."""
    return np.asarray(terms[..., _AT : _AT + 1] * (current.focus.rules.std_refocused / model.root[_AT, _AT]))


def with_focus(current: Map, views: WhitenedViews, columns: Array) -> WhitenedViews:
    """Return the views of a frame to come with its own focal length, in a map that has room for one."""
    watch = current.focus
    if not (watch.moves or current.has_focus):
        return views
    if watch.moves and len(watch.shown) == 1:
        _begin(current)
    return changed(views, own=np.concatenate([columns * watch.moves, views.own], axis=2))


def _begin(current: Map) -> None:
    """Give each frame of the window a focal length of its own, too: it may have begun to change before it showed."""
    model, views = current.frames[-1].rig if current.frames else None, current.views
    if not current.has_focus:
        current.has_focus = True
        current.own = np.insert(current.own, 0, 0.0, axis=1)
        current.views = changed(views, own=np.insert(views.own, 0, 0.0, axis=2))
        if (first := current.first_views) is not None:
            current.first_views = changed(first, own=np.insert(first.own, 0, 0.0, axis=2))
            current.prior = current.prior.with_own_of_first(6, 1)
            current.amplitudes = np.insert(current.amplitudes, 6, 0.0)
    if model is not None:
        own = current.views.own.copy()
        own[..., :1] = focus_columns(current, model, current.views.terms)
        current.views = changed(current.views, own=own)
