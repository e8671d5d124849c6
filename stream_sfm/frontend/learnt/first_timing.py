"""Applies the estimated delay and readout to the tracks.

In the first frame of a map, the motion of its points is unknown. So the effect of a late camera or a rolling shutter on
its views is corrected with the second frame, and its row differences are used then.
"""

from ...geometry import Array
from ...geometry.stereo import StereoProjection
from ...record import changed
from ..state import FrontEndState


def first_timed(projection: StereoProjection, state: FrontEndState, twist: Array, std_turning: float) -> FrontEndState:
    """Process what waited for a twist (6,) of the points: row differences, and track positions of the first frame.

    `std_turning`: σ of its rotation, as in `Timing`.
    """
    if state.rows_waiting is not None:
        state = changed(state, rows=state.rows.after(state.rows_waiting, twist, std_turning), rows_waiting=None)
    if state.timing.twist is not None:
        return state
    tracks, timing = state.tracks.begun_with(projection, twist), changed(state.timing, twist=twist)
    if timing.mean.any():
        tracks = tracks.shifted(projection, timing.taken_out(tracks.points, twist))
    return changed(state, tracks=tracks, timing=timing)


def learn_timing(projection: StereoProjection, state: FrontEndState, mean: Array, cov: Array) -> FrontEndState:
    """Update delay and readout to N(`mean` (2,), `cov` (2, 2)), seconds, and shift the tracks accordingly."""
    before, now = state.timing, state.timing.with_estimate(mean, cov)
    state = changed(state, timing=now)
    if now.twist is None or (before.mean == now.mean).all():
        return state
    points = state.tracks.points
    change_px = changed(now, mean=now.mean - before.mean).taken_out(points, now.twist)
    return changed(state, tracks=state.tracks.shifted(projection, change_px))
