"""Unknowns that each frame has beside its pose, eq. (36b): how they begin, get their effects, and end in a map.

Each is some columns of `own`: the effects (V, 4, n) px of amplitudes of σ = 1 on the views of a frame.
"""

import numpy as np

from ....geometry import Array
from ....record import changed
from ..layout import layout
from ..map import Map


def begin_unknown(current: Map, at: int, n: int) -> None:
    """Give each frame n more amplitudes of its own, before column `at`, which have no effect yet."""
    columns = [at] * n
    current.own = np.insert(current.own, columns, 0.0, axis=1)
    current.views = changed(current.views, own=np.insert(current.views.own, columns, 0.0, axis=2))
    if (first := current.first_views) is not None:
        current.first_views = changed(first, own=np.insert(first.own, columns, 0.0, axis=2))
        in_prior = layout(pose=6, own=at).size
        current.prior = current.prior.with_own_of_first(in_prior, n)
        current.amplitudes = np.insert(current.amplitudes, [in_prior] * n, 0.0)


def place_unknown(current: Map, rows: slice, columns: slice, effects: Array) -> None:
    """Set the effects (v, 4, n) px of an unknown on some of the window's views."""
    own = current.views.own.copy()
    own[rows, :, columns] = effects
    current.views = changed(current.views, own=own)


def end_unknown(current: Map, columns: slice) -> None:
    """Take an unknown from each frame. No view of the window shows it any more, and it is not in the prior."""
    current.own = np.delete(current.own, columns, axis=1)
    current.views = changed(current.views, own=np.delete(current.views.own, columns, axis=2))
