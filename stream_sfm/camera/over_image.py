"""Polynomials over rectified images: the raw rows of views, and what a longer focal length does to views."""

import numpy as np

from .. import core
from ..geometry import Array
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


@record
class FocalEffect:
    """By how much views move, px, where both focal lengths grow by themselves once: polynomials over the image.

    Each camera scales its own image about its own middle, with what its lens bends. Where cameras look towards each
    other, these middles are at different places of the rectified images, so the disparity of far points changes, too.
    `across`: columns, and `down`: rows, which left and right have in common, as of all that both have wrong alike.
    """

    across: ExposedRows
    down: ExposedRows

    def __call__(self, z_px: Array) -> Array:
        """Return by how much views (n, 4) move, (n, 4); not finite for a missing side."""
        moved = core.polynomial_rows(self.across, z_px)
        moved[:, 1::2] = core.polynomial_rows(self.down, z_px)[:, 1:2]
        return np.asarray(moved)
