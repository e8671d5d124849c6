"""The focal length as an unknown of each frame while it changes: how this begins and ends, eqs. (36c) and (72l)."""

import numpy as np

from ....geometry import Array
from ....geometry.resection import Resection
from ....record import changed
from ....rig_model.terms import FOCAL, TERMS
from ..absorb import with_rig_change
from ..inverse_depth import WhitenedViews
from ..state import WindowState
from .columns import with_effects, with_unknown

_AT = TERMS.index(FOCAL)


def effects_of_focus(current: WindowState, views: WhitenedViews) -> Array:
    """Return the effect (V, 4, 1) px of a change of the focal length by σ on views."""
    rules = current.prior.rig.rules
    return np.asarray(views.terms[..., _AT : _AT + 1] * (rules.std_refocused / rules.std_focal))


def with_focus(current: WindowState, views: WhitenedViews, effects: Array) -> tuple[WindowState, WhitenedViews]:
    """Return the state and the next frame's views with a focal length of its own, if that has ever changed.

    It is the first unknown of each frame.
    """
    if current.focus.has_begun:
        current = _begun(current)
    if not current.has_focus:
        return current, views
    return current, changed(views, own=np.concatenate([effects * current.focus.moves, views.own], axis=2))


def own_at_first(current: WindowState, motion: Resection) -> Array:
    """Return the initial `own` amplitudes (1, e) of a frame: the change of focal length found with its motion."""
    own = np.zeros((1, current.own.shape[1]))
    if current.focus.moves:
        own[0, 0] = motion.amplitudes[-1]
    return own


def placed_focus(current: WindowState) -> WindowState:
    """Evaluate the effect of the newest frame's focal length at the expected views, as for all errors of the rig.

    At the measured views, their noise would bias it a little. It would also bias the speed of the focus, which hardly
    anything else shows then, by several σ.
    """
    return _placed(current, current.newest) if current.focus.moves else current


def with_focus_at_rest(current: WindowState) -> WindowState:
    """Once a focal length has stopped changing, make it one of the rig's errors again."""
    rests_at = current.focus.rests_at
    if rests_at is None:
        return current
    current = changed(current, focus=current.focus.at_rest(rests_at))
    return with_rig_change(current, lambda rig: rig.refocused(rests_at))


def _begun(current: WindowState) -> WindowState:
    """Give each frame of the window a focal length of its own: the change may have begun before it became visible."""
    prior = changed(current.prior, rig=changed(current.prior.rig, zooms=True))
    current = changed(current, prior=prior)
    if not current.has_focus:
        current = with_unknown(changed(current, has_focus=True), 0, 1)
    return _placed(current, slice(None))


def _placed(current: WindowState, rows: slice) -> WindowState:
    """Set the effect of the focal length on some of the window's views from their terms."""
    return with_effects(current, rows, slice(0, 1), effects_of_focus(current, current.views[rows]))
