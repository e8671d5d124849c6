"""Whether an image is torn: some of its rows are those of the previous frame, because it was read while being written.

Pixels on slopes are compared. Noise and any motion change them, so that exactly equal ones are a copy.
"""

import numpy as np
from numpy.typing import NDArray

from .prepared import Image, PreparedImages

_BANDS = 16  # of rows that are judged together
_SLOPES = 20  # pixels on slopes that tell about a band, of every second column
_LEAST = 2  # bands that are copied, and bands that are not
_COPIED, _NEW = 0.98, 0.5  # shares of equal pixels: at least, and at most


def torn(images: PreparedImages, previous: PreparedImages | None, slope_grey: int) -> str:
    """Return a note if the upper or lower rows of an image are those of the previous frame; otherwise an empty string.

    `slope_grey`: least difference of grey values two pixels apart on a slope.
    """
    if previous is None:
        return ""
    for name, image, before in (("left", images.left, previous.left), ("right", images.right, previous.right)):
        if image.shape == before.shape and _ends_alike(image, before):
            shares = _equal(image, before, slope_grey)
            for part, from_end in (("upper", shares), ("lower", shares[::-1])):
                copied = int((np.append(from_end, 0.0) < _COPIED).argmax())
                new = from_end[copied + 1 :]  # the tear is within the band before
                if copied >= _LEAST and len(new) >= _LEAST and (new < _NEW).all():
                    return (
                        f"the {part} part of the {name} image is that of the previous frame: was it read while it was "
                        "written?"
                    )
    return ""


def _ends_alike(image: Image, before: Image) -> bool:
    """Whether most pixels of some first or last rows are equal, as in hardly any image."""
    rows = len(image) // _BANDS
    return any(bool((image[at] == before[at]).mean() > _NEW) for at in (slice(0, rows, 4), slice(-rows, None, 4)))


def _equal(image: Image, before: Image, slope_grey: int) -> NDArray[np.float64]:
    """Return the share of equal pixels on slopes in each band of rows that has enough of them."""
    slopes = np.abs(image[:, 2::2].astype(np.int16) - image[:, :-2:2]) >= slope_grey
    equal = slopes & (image[:, :-2:2] == before[:, :-2:2])
    starts = np.arange(_BANDS) * len(image) // _BANDS
    counts = (np.add.reduceat(each.sum(axis=1), starts) for each in (slopes, equal))
    there, same = counts
    return np.asarray(same[there >= _SLOPES] / there[there >= _SLOPES])
