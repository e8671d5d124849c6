"""The median of a few numbers: NumPy's own takes eight times as long for some hundred."""

import numpy as np

from .se3 import Array


def median(values: Array) -> float:
    """Return the median of finite values (n,), of one at least."""
    ordered, n = np.sort(values), len(values)
    return 0.5 * float(ordered[(n - 1) // 2] + ordered[n // 2])
