"""The reported estimate: the window's minimum with equally weighted views, beside that of the filter.

Neighbouring views of a track share temporally correlated errors, which cancel between two frames if these views have
equal weights. With the weights of eq. (69), which an unknown rig needs, they do not cancel: the motion over one frame
then has an error larger by a quarter to a half. So for the report the views of the window have their own covariances,
times one factor, eq. (69a), and one factor per track, eq. (69c). That minimum is one Newton step away, with prior and
rig unchanged. Nothing of it is fed back into them.
"""

import copy

import numpy as np

from ... import core
from ...record import changed
from .halves import SpanFactors, squares_of_halves
from .inverse_depth import linearise
from .map import Map
from .normal_equations import System
from .track_noise import TrackNoise


def reported(
    current: Map, factors: SpanFactors, noise: TrackNoise, learns: bool
) -> tuple[Map, SpanFactors, TrackNoise]:
    """Return the map to report estimates from, and the factors and the noise of tracks after this frame.

    `learns`: whether factors and noise are updated with this frame. If the views with these weights do not determine
    the window, `current` itself is returned.
    """
    try:
        return _reported(current, factors, noise, learns)
    except np.linalg.LinAlgError:
        return current, factors, noise


def _reported(
    current: Map, factors: SpanFactors, noise: TrackNoise, learns: bool
) -> tuple[Map, SpanFactors, TrackNoise]:
    """Return the same as `reported`. Raises LinAlgError if the views do not determine the window."""
    if learns and factors.asks_for(current.frames[-1].index):
        factors = factors.after(squares_of_halves(current, factors.rules))
    result, views, factor = copy.copy(current), current.views, factors.by_span[-1]
    ids, tracks = current.points.ids, core.squares_of_tracks(current.projection, current.state(), views)
    residuals = *tracks, core.among(ids, current.prior.ids)
    row = np.minimum(np.searchsorted(ids, views.ids), len(ids) - 1)
    share = np.where(ids[row] == views.ids, noise.information(*residuals)[row], 1.0)
    own = np.full_like(views.weight, 1 / factor) * np.sqrt(share)[:, None]
    result.views = changed(views, root=views.root * (own / views.weight)[:, None, :], weight=own)
    result.drop_undetermined()
    m, k = len(result.prior.rig), len(result.amplitudes)
    at = result.state()
    inertial = None
    if current.inertia is not None:  # a copy, so that nothing is fed back
        result.inertia = copy.copy(current.inertia)
        inertial = result.inertia.linearise(result.cams_from_ref, result.inertial_state)
    system = System(
        result.prior.given_rig(result.amplitudes[k - m :]),
        np.searchsorted(result.points.ids, result.prior.ids),
        linearise(result.projection, at, result.views, with_rig=False),
        result.points.q,
        result.amplitudes[: k - m],
        inertial,
        beside=current.system,
    )
    if learns:
        noise = noise.after(*residuals)
    result.follow(system)
    system.with_rig_of(current.system, np.searchsorted(current.points.ids, result.points.ids))
    return result, factors, noise
