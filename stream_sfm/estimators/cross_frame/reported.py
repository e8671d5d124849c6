"""What is reported: the window's minimum with all views of one weight, next to the one that the filter goes on from.

Errors that last are shared by neighbouring views of a track, and cancel between two frames, as long as these views have
one weight. With those of eq. (69), which an unknown rig needs, they do not: then the motion over one frame errs by a
quarter to a half more. So the views of the window are given their own covariances, times one factor, and what is reported
is a Newton step away, with the prior and the rig's errors as they are. Nothing of it is fed back.
"""

import copy

import numpy as np

from ...record import changed
from .halves import SpanFactors, squares_of_halves
from .map import Map


def reported(current: Map, factors: SpanFactors, learns: bool) -> tuple[Map, SpanFactors]:
    """Return the map that estimates are read off, and the factors after this frame.

    `learns`: whether errors may last, and this frame tells. Where a view less leaves a point open, it is the same map.
    """
    try:
        return _reported(current, factors, learns)
    except np.linalg.LinAlgError:
        return current, factors


def _reported(current: Map, factors: SpanFactors, learns: bool) -> tuple[Map, SpanFactors]:
    """Return the map of `reported`. Raises LinAlgError where its views do not determine it."""
    result, views = copy.copy(current), current.views
    factor = factors.by_span[-1]
    own = np.full_like(views.weight, 1 / factor)
    result.views = changed(views, root=views.root * (own / views.weight)[:, None, :], weight=own)
    result.drop_undetermined()
    before = result.state()
    result.gauss_newton_step()
    result.system.cov_rig = current.system.cov_rig
    if learns:
        factors = factors.after(factor**2 * squares_of_halves(result, before))
    return result, factors
