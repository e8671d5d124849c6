"""The reported estimate: the window's minimum with equally weighted views, beside that of the filter, eq. (69a).

Temporally correlated errors cancel between two frames if the views of a track have equal weights. With the weights of
eq. (69), which an unknown rig needs, the motion over one frame has an error larger by a quarter to a half. This minimum
is one Newton step away, with prior and rig unchanged. Nothing of it is fed back into them.
"""

import numpy as np

from .... import core
from ....record import changed
from ..minimise import stepped, without_undetermined
from ..normal_equations import System
from ..state import WindowState
from .halves import SpanFactors, squares_of_halves
from .track_noise import TrackNoise


def reported(
    current: WindowState, factors: SpanFactors, noise: TrackNoise, learns: bool
) -> tuple[WindowState, SpanFactors, TrackNoise]:
    """Return the map to report estimates from, and the factors and the noise of tracks after this frame.

    `learns`: whether factors and noise are updated with this frame. If the views with these weights do not determine
    the window, `current` itself is returned.
    """
    try:
        return _reported(current, factors, noise, learns)
    except np.linalg.LinAlgError:
        return current, factors, noise


def _reported(
    current: WindowState, factors: SpanFactors, noise: TrackNoise, learns: bool
) -> tuple[WindowState, SpanFactors, TrackNoise]:
    """Return the same as `reported`. Raises LinAlgError if the views do not determine the window."""
    if learns and factors.asks_for(current.frames[-1].index):
        factors = factors.after(squares_of_halves(current, factors.rules))
    views, factor = current.views, factors.by_span[-1]
    ids, tracks = current.points.ids, core.squares_of_tracks(current.projection, current.state, views)
    residuals = *tracks, core.among(ids, current.prior.ids)
    row = np.minimum(np.searchsorted(ids, views.ids), len(ids) - 1)
    share = np.where(ids[row] == views.ids, noise.information(*residuals)[row], 1.0)
    own = np.full_like(views.weight, 1 / factor) * np.sqrt(share)[:, None]
    views = changed(views, root=views.root * (own / views.weight)[:, None, :], weight=own)
    result = without_undetermined(changed(current, views=views))  # nothing of it is fed back
    result, solved, _ = stepped(result, with_rig=False)
    if learns:
        noise = noise.after(*residuals)
    system = System.of(current.system.prior, result.points.ids, solved, result.own.size, beside=current.system)
    return changed(result, solved=system), factors, noise
