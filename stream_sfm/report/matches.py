"""The stereo and temporal matches of one frame as needles on its image, the paper's Figure 4."""

from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from ..geometry import Array
from .svg import needles


class Needles(NamedTuple):
    """The matches of one `frame` on its rectified left `image` (h, w).

    `stereo_px` (n, 2, 2): left and right places of its points; `temporal_px` (m, 2, 2): left places of those that were
    also seen in the previous frame, there and now. `used` (n,) and `used_again` (m,): without those that the estimator
    rejected.
    """

    frame: int
    image: NDArray[np.uint8]
    stereo_px: Array
    temporal_px: Array
    used: NDArray[np.bool_]
    used_again: NDArray[np.bool_]


def matches(found: Needles | None) -> list[Markup]:
    """Draw the stereo and temporal matches of a frame as needles, the paper's Figure 4."""
    if found is None:
        return []
    drawn = []
    for title, ends, used, ways in (
        (
            "Stereo matches",
            found.stereo_px[:, ::-1],
            found.used,
            "from the place in the right image to that in the left",
        ),
        (
            "Temporal matches",
            found.temporal_px,
            found.used_again,
            "from the place in the previous frame to the current",
        ),
    ):
        groups = [("used", "ok", ends[used]), ("rejected by the estimator", "lost", ends[~used])]
        drawn.append(needles(title, f"{ways} (dot); frame {found.frame}", found.image, groups))
    return drawn
