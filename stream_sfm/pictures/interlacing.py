"""Checks whether images are interlaced: its odd and even rows were exposed at different times.

Whatever moves is then combed. With S(k) the mean squared difference of pixels k rows apart, S(3) and S(5) are larger
than their neighbours suggest; in images of one moment S is smooth, and noise adds the same to each. If a sensor's even
rows are brighter than its odd ones, the means of the rows show it, and the difference is removed.
"""

from typing import ClassVar

import numpy as np

from ..geometry.medians import median
from ..record import record
from .prepared import Image, PreparedImages, outer_columns
from .view import View

# Sound images, real and rendered, have at most 0.04; interlaced ones with motion have 0.04 to 6.
_COMBED = 0.06
_NATS = 12.0  # of a frame whose rows are not combed at all, or twice as much: it decides
_STILL_PX, _MOVES_PX = 0.3, 1.5  # median motion from frame to frame: nothing is combed below, all of it is above
# Bands of rows that are judged separately. Those with the largest excess do not count, because a line may be drawn
# across the image in one or two of them.
_BANDS, _LEFT_OUT = 10, 2
_LEAST_GREY2 = 1.0  # squared difference of rows; images without texture have less


@record
class Interlaced:
    """Looks for combed rows while the view moves."""

    sentence: ClassVar[str] = (
        "odd and even rows show different moments: is the video interlaced? Record it in whole frames (progressive)"
    )
    of_pair: ClassVar[bool] = False

    @property
    def earlier(self) -> int:
        """The frame before, for the motion."""
        return 1

    def nats(self, images: PreparedImages, views: tuple[View, ...]) -> float | None:
        """Return the evidence of a moving frame, or None."""
        if images.delivered is None or len(views) < 2:
            return None
        moved_px = np.linalg.norm(views[-1].left_px - views[-2].of(views[-1].ids), axis=1)
        moved_px = moved_px[np.isfinite(moved_px)]
        moved = median(moved_px) if len(moved_px) else 0.0
        if moved < _STILL_PX:
            return None
        nats = float(np.clip(_NATS * (combed(images.delivered.left_columns) / _COMBED - 1), -_NATS, _NATS))
        return nats if nats > 0 or moved > _MOVES_PX else None


def is_interlaced(image: Image) -> bool:
    """Return whether an image (h, w), as recorded, shows it; if nothing moves, it does not."""
    return combed(outer_columns(image)) > _COMBED


def combed(image: Image) -> float:
    """Return the excess of S(k) for odd k over what its neighbours suggest, relative to S(2)."""
    grey = image.T.astype(np.float32)
    columns, rows = grey.shape
    size = (rows - 5) // _BANDS
    if size < 1:
        return 0.0
    grey[:, ::2] -= grey[:, ::2].mean() - grey[:, 1::2].mean()
    s2, s3, s4, s5 = (
        ((grey[:, 5:] - grey[:, 5 - k : -k]) ** 2)[:, : _BANDS * size].reshape(columns, _BANDS, size).mean(axis=(0, 2))
        for k in (2, 3, 4, 5)
    )
    excess = (3 * s3 - s2 - 3 * s4 + s5) / 4
    kept = np.argsort(excess)[:-_LEFT_OUT]
    return float(excess[kept].sum() / max(s2[kept].sum(), _LEAST_GREY2 * len(kept)))
