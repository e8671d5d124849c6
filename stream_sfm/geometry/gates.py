"""Gates of squared whitened residuals: quantiles of χ² for the degrees of freedom that stereo views have.

They are computed here because importing SciPy's costs more time than the first ten frames of a run.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .se3 import Array

_MAX_STEPS = 50  # measured: six are enough for every probability that a double can hold
_RELATIVE_STEP = 1e-13  # a few hundred roundings of a double


@lru_cache
def chi2_gate(dof: int, probability: float) -> float:
    """Return the x with P(χ² ≤ x) = `probability` in (0, 1), for 2 or 4 degrees of freedom.

    P is 1 − e^{−x/2} for 2 and 1 − e^{−x/2} (1 + x/2) for 4.
    """
    rest = 1 - probability
    x = -2 * math.log(rest)
    if dof == 2:
        return x
    for _ in range(_MAX_STEPS):  # Newton on −x/2 + log(1 + x/2) − log(rest), concave: it converges from above
        step = (-x / 2 + math.log1p(x / 2) - math.log(rest)) * (2 + x) * 2 / x if x > 0 else 1.0
        x += step
        if abs(step) < _RELATIVE_STEP * x:
            break
    return x


def chi2_gates(dof: NDArray[np.integer], probability: float) -> Array:
    """Return the gate (n,) of views with 4 measured coordinates or with 2 (n,); any other number counts as 2."""
    return np.where(dof == 4, chi2_gate(4, probability), chi2_gate(2, probability))
