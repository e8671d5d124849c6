"""The focal length as an unknown of each frame while it changes: how this begins and ends, eqs. (36c) and (72l)."""

import numpy as np
from numpy.typing import NDArray

from ....geometry import Array
from ....geometry.point_views import PointViews
from ....geometry.resection import Resection
from ....record import changed
from ....rig_model.terms import FOCAL, TERMS
from ..inverse_depth import WhitenedViews
from ..map import Map
from .columns import begin_unknown, place_unknown

_AT = TERMS.index(FOCAL)


def judge_focus(
    current: Map, views: WhitenedViews, rows: NDArray[np.intp], seen: PointViews, weights: Array, found: Resection
) -> tuple[Resection, WhitenedViews]:
    """Return the motion to the next frame, with a focal length of its own if that changes, and the frame's views.

    `found`: the motion without it; `seen`: the `rows` of the views from which it was found, with `weights` (n,).
    """
    columns = _columns(current, views)
    current.focus, motion = current.focus.judge(
        seen.with_shared(columns[rows]), weights, found, informative=not current.exposures.by_twist.any()
    )
    if current.focus.has_begun:
        _begin(current)
    if current.has_focus:
        views = changed(views, own=np.concatenate([columns * current.focus.moves, views.own], axis=2))
    return motion, views


def own_at_first(current: Map, motion: Resection) -> Array:
    """Return the initial `own` amplitudes (1, e) of a frame: the change of focal length found with its motion."""
    own = np.zeros((1, current.own.shape[1]))
    if current.focus.moves:
        own[0, 0] = motion.amplitudes[-1]
    return own


def place_focus(current: Map) -> None:
    """Evaluate the effect of the newest frame's focal length at the expected views, as for all errors of the rig.

    At the measured views, their noise would bias it a little. It would also bias the speed of the focus, which hardly
    anything else shows then, by several σ.
    """
    if current.focus.moves:
        _place(current, current.newest)


def end_refocusing(current: Map) -> None:
    """Once a focal length has stopped changing, make it one of the rig's errors again."""
    rests_at = current.focus.rests_at
    if rests_at is not None:
        current.focus = current.focus.at_rest(rests_at)
        current.change_rig(lambda rig: rig.refocused(rests_at))


def _columns(current: Map, views: WhitenedViews) -> Array:
    """Return the effect (V, 4, 1) px of a change of the focal length by σ on views."""
    rules = current.prior.rig.rules
    return np.asarray(views.terms[..., _AT : _AT + 1] * (rules.std_refocused / rules.std_focal))


def _begin(current: Map) -> None:
    """Give each frame of the window a focal length of its own: the change may have begun before it became visible."""
    current.prior = changed(current.prior, rig=changed(current.prior.rig, zooms=True))
    if not current.has_focus:
        current.has_focus = True
        begin_unknown(current, 0, 1)
    _place(current, slice(None))


def _place(current: Map, rows: slice) -> None:
    """Set the effect of the focal length on some of the window's views from their terms."""
    place_unknown(current, rows, slice(0, 1), _columns(current, current.views[rows]))
