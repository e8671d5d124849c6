"""Which unknowns of the newest frame explain what its views share: one likelihood for all, eqs. (7b) and (72l).

The right camera may turn more than usual, the twist may differ more than usual from the expected one, and the focal
length may change. Each moves all views of the frame alike, must have its size before single views are gated, and must
not be taken for another.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ....geometry import Array
from ....geometry.point_views import PointViews
from ....geometry.resection import Resection, refine
from ....geometry.sizes import Sizes, weigh
from ....record import changed
from ..inverse_depth import WhitenedViews
from ..state import WindowState
from .focus import effects_of_focus, with_focus
from .twist import TWIST


def weigh_unknowns(
    current: WindowState,
    sizes: Sequence[Sizes],
    views: WhitenedViews,
    rows: NDArray[np.intp],
    seen: PointViews,
    weights: Array,
    found: Resection,
) -> tuple[WindowState, list[Sizes], WhitenedViews, Resection]:
    """Return the state, the sizes of turn and twist in the next frame, its views with all unknowns, and its motion.

    `sizes`: before the frame. `seen`: the `rows` of `views` from which the motion was `found`, with `weights` (n,) as
    in `resect`; the first errors that they share are those of `views.own`, of size 1. If an unknown is larger, or the
    focal length changes, the motion is found again. Its second motion stays: these need not be its views.
    """
    of_twist = TWIST * current.exposures.has_twist
    own, lengths = views.own.shape[2], (views.own.shape[2] - of_twist, of_twist)
    focal, start = effects_of_focus(current, views), np.append(found.amplitudes, 0.0)
    seen = seen.with_shared(focal[rows])
    sizes, factors, shared = list(sizes), np.ones(len(start)), refine(seen, weights, found.cam_from_ref, start)
    if shared.ok:
        at = [*range(own), -1]
        shown = weigh(shared.amplitudes[at], shared.cov_amplitudes[np.ix_(at, at)], lengths)
        focus, log_likelihoods = current.focus.after(shown, sizes)
        current = changed(current, focus=focus)
        sizes = shown.sizes(sizes, log_likelihoods)
        factors[:own] = np.repeat([s.probable for s in sizes], lengths)
    motion = changed(found, amplitudes=start / factors)
    factors[-1] = current.focus.moves
    if (factors[:-1] != 1).any() or current.focus.moves:
        again = refine(seen.scaled(factors), weights, found.cam_from_ref, motion.amplitudes)
        motion = changed(again, second=found.second) if again.ok else motion
    current, views = with_focus(current, changed(views, own=views.own * factors[:own]), focal)
    return current, sizes, views, motion
