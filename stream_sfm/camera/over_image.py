"""Polynomials over rectified images: the raw rows of views, and the effect of a longer focal length on views."""

import numpy as np

from .. import core
from ..geometry import Array
from ..record import record


@record
class ExposedRows:
    """Raw rows: polynomials over a rectified image of `size_px`; `coefficients` (s, k, k), s 1 for both sides or 2.

    An accuracy of a thousandth of the height is enough.
    """

    size_px: tuple[int, int]
    coefficients: Array

    @classmethod
    def unknown(cls) -> "ExposedRows":
        """Return the polynomials that put all views in the middle row, where a readout has no effect."""
        return cls((1, 1), np.zeros((1, 1, 1)))

    def __call__(self, z_px: Array) -> Array:
        """Return the rows (n, 4) of views (n, 4): shares of the height, from −½ at the top to ½."""
        return core.polynomial_rows(self, z_px)


@record
class FocalEffect:
    """The motion of views, px, as both focal lengths double: polynomials over the image.

    Each camera scales its own image, with its distortion, about its own middle. With converging cameras, these middles
    are at different places of the rectified images, so the disparity of far points also changes. `across`: columns;
    `down`: rows, which left and right have in common, as for all errors that both share.
    """

    across: ExposedRows
    down: ExposedRows

    def __call__(self, z_px: Array) -> Array:
        """Return the motion (n, 4) of views (n, 4); not finite for a missing side."""
        moved = core.polynomial_rows(self.across, z_px)
        moved[:, 1::2] = core.polynomial_rows(self.down, z_px)[:, 1:2]
        return np.asarray(moved)
