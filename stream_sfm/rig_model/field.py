"""A smooth field that is fixed in the image: a low-rank Gaussian process, for errors that no physical term follows.

Row errors of different tracks at one place of the image correlate for seconds, over a distance of about a tenth of the
image's width (kitti06, kitti00_mid: 120 px of 1241; euroc_mh01: 80 of 752); those of rendered images do not. The
process is N(0, σ² k), k = exp(−d²/(2ℓ²)), known at a grid of inducing points (Quiñonero-Candela and Rasmussen 2005).
The front-end estimates all of its functions from rows, the window those that are worth an unknown.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from .. import core
from ..geometry import Array

LEAST_PX = 1e-3  # σ: a field of σ 0 would have no amplitudes

# ℓ over the width. The evidence of three real logs is flat from 0.07 to there, and a longer field needs fewer
# functions. With all functions, kitti06 errs from six first frames by 0.97 of what it does with 0.1.
_LENGTH = 0.13

# The share of a field's variance that is worth its unknowns in a window. Those are 19 functions of 24 at 752 × 480 and
# 11 of 18 at 1226 × 370. Motions of kitti06 from six first frames, and 150 frames of euroc_mh01 from two, err by 1.00
# and 0.98 of what they do with all of them. With 7/8 of the variance poses of kitti06 err by 1.5 times as much.
WORTH_ESTIMATING = 0.95


class Field(NamedTuple):
    """The basis of a field over an image, as the compiled core takes it: K functions of amplitudes with σ = 1.

    `u_px` and `v_px`: columns and rows of the grid of inducing points; `length_px`: ℓ; `root` (points, K): the
    functions as sums of the kernels at these points.
    """

    u_px: Array
    v_px: Array
    length_px: float
    root: Array

    @property
    def size(self) -> int:
        """The number K of functions."""
        return self.root.shape[1]

    def at(self, left_px: Array) -> Array:
        """Return the basis (n, K) at positions (n, 2) of the left image; 0 where one is not finite."""
        return core.field_basis(self, left_px)


NO_FIELD = Field(np.zeros(0), np.zeros(0), 1.0, np.zeros((0, 0)))


@lru_cache(maxsize=8)
def field_over(width: int, height: int, share: float = 1.0) -> Field:
    """Return the field over images of this size in functions of Karhunen and Loève, eq. (70d), the largest ones first.

    As many as have a `share` of its variance at the inducing points; these are about 1.3 ℓ apart.
    """
    across = 6
    down = max(3, round(across * height / width))
    u, v = (np.arange(across) + 0.5) / across * width, (np.arange(down) + 0.5) / down * height
    nodes = np.stack(np.meshgrid(u, v), axis=2).reshape(-1, 2)
    grid = Field(u, v, _LENGTH * width, np.eye(len(nodes)))
    variances, functions = np.linalg.eigh(grid.at(nodes))
    before = np.cumsum(variances[::-1]) - variances[::-1]  # of the functions before each
    leading = slice(-1, -1 - np.count_nonzero(before < share * variances.sum()), -1)
    return grid._replace(root=np.ascontiguousarray(functions[:, leading] / np.sqrt(variances[leading])))
