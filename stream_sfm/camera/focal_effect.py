"""What a longer focal length of the cameras' own images does to the views of rectified ones."""

import numpy as np

from .. import core
from ..geometry.se3 import Array
from ..record import record
from .exposed_rows import ExposedRows


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
