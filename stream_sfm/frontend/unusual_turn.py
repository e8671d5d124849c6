"""The right camera seems to have turned: the motion is sought by the left sides until it is clear whether it has."""

from ..geometry.se3 import Array
from ..record import changed
from .seen import Seen
from .state import FrontEndState


def without_turned(state: FrontEndState, seen: Seen, cam_from_previous: Array) -> tuple[FrontEndState, Seen | None]:
    """Return the state after a frame near a motion (4, 4), and its left sides where it shows an unusual turn."""
    if state.turn_watch is None or seen.cov_turn is None:
        return state, None
    points, cov_points = seen.point_views.points, seen.point_views.cov_points
    views = points, cov_points, seen.views.any_row_px, seen.views.cov_px
    watch, agree = state.turn_watch.judge(*views, cam_from_previous, seen.cov_turn)
    return changed(state, turn_watch=watch), None if agree is None else seen.by_left(agree)
