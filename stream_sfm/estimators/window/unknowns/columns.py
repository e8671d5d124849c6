"""Unknowns that each frame has beside its pose, eq. (36b): how they begin, get their effects, and end in a map.

Each is some columns of `own`: the effects (V, 4, n) px of amplitudes of σ = 1 on the views of a frame.
"""

import numpy as np

from ....geometry import Array
from ....record import changed
from ..layout import layout
from ..state import WindowState


def with_unknown(current: WindowState, at: int, n: int) -> WindowState:
    """Give each frame n more amplitudes of its own, before column `at`, which have no effect yet."""
    columns, first, prior, amplitudes = [at] * n, current.first_views, current.prior, current.amplitudes
    if first is not None:
        first = changed(first, own=np.insert(first.own, columns, 0.0, axis=2))
        in_prior = layout(pose=6, own=at).size
        prior, amplitudes = prior.with_own_of_first(in_prior, n), np.insert(amplitudes, [in_prior] * n, 0.0)
    return changed(
        current,
        own=np.insert(current.own, columns, 0.0, axis=1),
        views=changed(current.views, own=np.insert(current.views.own, columns, 0.0, axis=2)),
        first_views=first,
        prior=prior,
        amplitudes=amplitudes,
    )


def with_effects(current: WindowState, rows: slice, columns: slice, effects: Array) -> WindowState:
    """Set the effects (v, 4, n) px of an unknown on some of the window's views."""
    own = current.views.own.copy()
    own[rows, :, columns] = effects
    return changed(current, views=changed(current.views, own=own))


def without_unknown(current: WindowState, columns: slice) -> WindowState:
    """Take an unknown from each frame. No view of the window shows it any more, and it is not in the prior."""
    views = changed(current.views, own=np.delete(current.views.own, columns, axis=2))
    return changed(current, views=views, own=np.delete(current.own, columns, axis=1))
