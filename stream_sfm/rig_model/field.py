"""A smooth field that is fixed in the image: a low-rank Gaussian process, for errors that no physical term follows.

Row errors of different tracks at one place of the image correlate for seconds, over a distance of about a tenth of the
image's width (kitti06, kitti00_mid: 120 px of 1241; euroc_mh01: 80 of 752); those of rendered images do not. The
process is N(0, σ² k), k = exp(−d²/(2ℓ²)), known at a grid of inducing points (Quiñonero-Candela and Rasmussen 2005).
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from .. import core
from ..geometry import Array

LEAST_PX = 1e-3  # σ: a field of σ 0 would have no amplitudes


class Field(NamedTuple):
    """The basis of a field over an image, as the compiled core takes it: K functions of amplitudes with σ = 1.

    `u_px` and `v_px`: columns and rows of the grid of inducing points; `length_px`: ℓ; `root` (K, K): makes the
    amplitudes of the inducing points independent.
    """

    u_px: Array
    v_px: Array
    length_px: float
    root: Array

    @property
    def size(self) -> int:
        """K."""
        return len(self.root)

    def at(self, left_px: Array) -> Array:
        """Return the basis (n, K) at positions (n, 2) of the left image; 0 where one is not finite."""
        return core.field_basis(self, left_px)


NO_FIELD = Field(np.zeros(0), np.zeros(0), 1.0, np.zeros((0, 0)))


@lru_cache(maxsize=8)
def field_over(width: int, height: int) -> Field:
    """Return the field over images of this size.

    ℓ is a tenth of the width: the evidence of three real logs is flat from 0.07 to 0.13. The inducing points are 1.6 ℓ
    apart. With 1.25 ℓ the field has more of its variance, with twice the amplitudes: kitti00_mid is then 8 %
    better, kitti06 worse by a half, and an estimate takes half as long again.
    """
    length_px = 0.1 * width
    across = round(1 / 0.16)
    down = max(3, round(across * height / width))
    u, v = (np.arange(across) + 0.5) / across * width, (np.arange(down) + 0.5) / down * height
    nodes = np.stack(np.meshgrid(u, v), axis=2).reshape(-1, 2)
    grid = Field(u, v, length_px, np.eye(len(nodes)))
    own = grid.at(nodes) + 1e-4 * np.eye(len(nodes))  # invertible
    return grid._replace(root=np.linalg.inv(np.linalg.cholesky(own)).T)
