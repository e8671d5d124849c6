"""Sets of track ids, which are ascending arrays everywhere in the estimators."""

import numpy as np
from numpy.typing import NDArray

Ids = NDArray[np.int64]


def among(ids: Ids, known: Ids) -> NDArray[np.bool_]:
    """Return which of `ids` (n,) are in `known` (ascending): np.isin in a sixth of its time for a few hundred ids."""
    if not len(known):
        return np.zeros(len(ids), bool)
    at = np.searchsorted(known, ids)
    at[at == len(known)] = 0
    return np.asarray(known[at] == ids)
