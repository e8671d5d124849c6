"""The turn of the right camera as an unknown of each frame: how large it is in the newest one, eqs. (36b) and (7b).

The front-end measures turns before the delay, the depths and the motion are estimated together. A turn that is larger
than usual moves all right views alike, and must have its size before single views are gated.
"""

import numpy as np

from ....geometry import Array
from ....geometry.point_views import PointViews
from ....geometry.resection import Resection, refine
from ....geometry.sizes import Sizes
from ....record import changed


def size_turn(
    sizes: Sizes, e: int, seen: PointViews, weights: Array, found: Resection
) -> tuple[Sizes, PointViews, Resection]:
    """Return the sizes of turns after a frame, and with turns of the probable size its views and its motion.

    A turn is the first `e` of the errors that the views `seen` share. `found`: the motion with turns of size 1, with
    `weights` (n,) as in `resect`.
    """
    sizes = sizes.after_amplitudes(found.amplitudes[:e], found.cov_amplitudes[:e, :e])
    if sizes.probable == 1.0:
        return sizes, seen, found
    factors = np.ones(len(found.amplitudes))
    factors[:e] = sizes.probable
    seen = seen.scaled(factors)
    larger = refine(seen, weights, found.cam_from_ref, found.amplitudes / factors)
    if not larger.ok:
        return sizes, seen, changed(found, amplitudes=found.amplitudes / factors)
    return sizes, seen, changed(larger, second=found.second)
