"""Whether an image is interlaced: its odd and even rows were exposed at different times.

Whatever moves is then combed: adjacent rows differ by more than their distance explains. With S(k) the mean squared
difference of pixels k rows apart, S(3) and S(5) are larger than their neighbours S(2) and S(4) suggest, and S(4) is
smaller. In images of one moment S is smooth; noise adds the same amount to each S(k). If a sensor's even rows are
brighter than its odd ones, the means of the rows show it, and the difference is removed.
"""

import numpy as np

from .prepared import Image

# Sound images, real and rendered, have at most 0.03; interlaced ones with motion have 0.04 to 6.
_COMBED = 0.06
_EVERY = 4  # columns, enough to see it
# Bands of rows that are judged separately. Those with the largest excess do not count, because a line may be drawn
# across the image in one or two of them.
_BANDS, _LEFT_OUT = 10, 2
_LEAST_GREY2 = 1.0  # squared difference of rows; images without texture have less


def is_interlaced(image: Image) -> bool:
    """Return whether an image (h, w), as recorded, shows it; if nothing moves, it does not."""
    return combed(image) > _COMBED


def combed(image: Image) -> float:
    """Return the excess of S(k) for odd k over what its neighbours suggest, relative to S(2)."""
    grey = image.T[::_EVERY].astype(np.float32)
    columns, rows = grey.shape
    size = (rows - 5) // _BANDS
    if size < 1:
        return 0.0
    grey[:, ::2] -= grey[:, ::2].mean() - grey[:, 1::2].mean()
    s2, s3, s4, s5 = (
        ((grey[:, 5:] - grey[:, 5 - k : -k]) ** 2)[:, : _BANDS * size]
        .reshape(columns, _BANDS, size)
        .mean(axis=(0, 2))
        for k in (2, 3, 4, 5)
    )
    excess = (3 * s3 - s2 - 3 * s4 + s5) / 4
    kept = np.argsort(excess)[:-_LEFT_OUT]
    return float(excess[kept].sum() / max(s2[kept].sum(), _LEAST_GREY2 * len(kept)))
