"""Whether an image is torn: some of its rows are those of the previous frame, because it was read while being written.

Pixels on slopes are compared. Noise and any motion change them, so that exactly equal ones are a copy. Rows that were
equal in the frame before, too, show what never moves: a picture over the image, or a vehicle's own body without noise.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .prepared import Image, PreparedImages

_BANDS = 16  # of rows that are judged together
_SLOPES = 20  # pixels on slopes that tell about a band, of every second column
_LEAST = 2  # bands that are copied, and bands that are not
_COPIED = 0.98  # share of equal pixels, at least
_NEW = 0.6  # at most: 0.44 or less stay equal without noise where rows move by 0.1 px, the σ of views, on 18 logs


class Copied(NamedTuple):
    """How many bands of rows of each image are those of the frame before: positive from above, negative from below.

    None if there is none before, or if all that the image shows is the same.
    """

    left: int | None
    right: int | None


def copied(images: PreparedImages, previous: PreparedImages | None, slope_grey: int) -> Copied:
    """Return which rows are those of the previous frame.

    `slope_grey`: least difference of grey values two pixels apart on a slope.
    """
    if previous is None:
        return Copied(None, None)
    left = _bands(images.left, previous.left, slope_grey)
    right = _bands(images.right, previous.right, slope_grey)
    return Copied(left, right)


def torn(now: Copied, before: Copied) -> str:
    """Return a note if an image has copied rows, which were not copied in the frame `before`; or an empty string."""
    for name, bands, bands_before in zip(("left", "right"), now, before, strict=True):
        if bands and bands_before is not None and bands * bands_before <= 0:
            part = "upper" if bands > 0 else "lower"
            rows = f"the {part} part of the {name} image is that of the previous frame"
            return f"{rows}: was it read while it was written?"
    return ""


def _bands(image: Image, before: Image, slope_grey: int) -> int | None:
    """Return the number of bands that were copied, or None if all were."""
    if image.shape != before.shape or not _ends_alike(image, before):
        return 0
    shares = _equal(image, before, slope_grey)
    if (shares >= _COPIED).all():
        return None
    for sign, from_end in ((1, shares), (-1, shares[::-1])):
        n = int((from_end < _COPIED).argmax())
        new = from_end[n + 1 :]  # the tear is within the band before
        if n >= _LEAST and len(new) >= _LEAST and new.mean() < _NEW:
            return sign * n
    return 0


def _ends_alike(image: Image, before: Image) -> bool:
    """Whether most pixels of some first or last rows are equal, as in hardly any image."""
    rows = len(image) // _BANDS
    ends = ((image[at], before[at]) for at in (slice(0, rows, 4), slice(-rows, None, 4)))
    return any(np.count_nonzero(now == then) / now.size > _NEW for now, then in ends)


def _equal(image: Image, before: Image, slope_grey: int) -> NDArray[np.float64]:
    """Return the share of equal pixels on slopes in each band of rows that has enough of them."""
    slopes = np.abs(image[:, 2::2].astype(np.int16) - image[:, :-2:2]) >= slope_grey
    equal = slopes & (image[:, :-2:2] == before[:, :-2:2])
    starts = np.arange(_BANDS) * len(image) // _BANDS
    there, same = (np.add.reduceat(each.sum(axis=1), starts) for each in (slopes, equal))
    return np.asarray(same[there >= _SLOPES] / there[there >= _SLOPES])
