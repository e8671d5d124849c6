"""In which rows of the cameras' own images the views of rectified ones were exposed."""

import numpy as np

from .. import core
from ..geometry.se3 import Array
from ..record import record


@record
class ExposedRows:
    """Polynomials over a rectified image of `size_px`, with `coefficients` (s, k, k) for both sides or for each.

    A thousandth of the height is exact enough.
    """

    size_px: tuple[int, int]
    coefficients: Array

    @classmethod
    def unknown(cls) -> "ExposedRows":
        """All views in the middle row, where a readout does nothing."""
        return cls((1, 1), np.zeros((1, 1, 1)))

    def __call__(self, z_px: Array) -> Array:
        """Return the rows (n, 4) of views (n, 4): shares of the height from the middle, −½ at the top to ½."""
        return core.polynomial_rows(self, z_px)
