"""Gates of squared whitened residuals: quantiles of χ² for the degrees of freedom that stereo views have.

They are computed here because importing SciPy's costs more time than the first ten frames of a run.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .se3 import Array


@lru_cache
def chi2_gate(dof: int, probability: float) -> float:
    """Return the x with P(χ² ≤ x) = `probability` in (0, 1), for 2 or 4 degrees of freedom.

    P is 1 − e^{−x/2} for 2 and 1 − e^{−x/2} (1 + x/2) for 4.
    """
    log_rest = math.log(1 - probability)
    if dof == 2:
        return -2 * log_rest
    # Newton on the concave log(1 + y) − y − log(rest) with y = x/2: from above, as here, each step goes down
    y, closer = math.inf, 0.4 - 2 * log_rest
    while closer < y:
        y = closer
        closer = y + (math.log1p(y) - y - log_rest) * (1 + y) / y
    return 2 * y


def chi2_gates(dof: NDArray[np.integer], probability: float) -> Array:
    """Return the gate (n,) of views with 4 measured coordinates or with 2 (n,); any other number counts as 2."""
    return np.where(dof == 4, chi2_gate(4, probability), chi2_gate(2, probability))
