"""Sets of track ids, which are ascending arrays everywhere in the estimators."""

import numpy as np
from numpy.typing import NDArray

from .. import core

Ids = NDArray[np.int64]


def among(ids: Ids, known: Ids) -> NDArray[np.bool_]:
    """Return which of `ids` (n,) are in `known`, which is ascending."""
    return core.among(ids, known)


def times_among(ids: Ids, others: Ids, counted: NDArray[np.bool_]) -> Ids:
    """Return how often each of `ids` (n,), which are ascending, is in those of `others` (m,) that are `counted`."""
    return core.times_among(ids, others, counted)


def union(*sets: Ids) -> Ids:
    """Return the ids of one set at least, ascending; the sets may be in any order."""
    return core.union_of(np.concatenate(sets))
