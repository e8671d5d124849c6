"""Conversion of the arrays that cameras and programs deliver to 8-bit grey images (h, w), which the package uses."""

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from ..system.wording import described
from .settings import SETTINGS

Grey: TypeAlias = NDArray[np.uint8] | NDArray[np.uint16]

FEWEST_BITS = 10  # in use in a 16-bit image: sensors with more than 8 bits have 10, 12, 14 or 16
_TO_GREY = {3: cv2.COLOR_BGR2GRAY, 4: cv2.COLOR_BGRA2GRAY}


def bits_used(*images: Grey) -> int:
    """Return how many of 16 bits images (h, w) use, without their brightest pixels; `FEWEST_BITS` for 8-bit images."""
    bits = FEWEST_BITS
    for image in images:
        if image.dtype == np.uint16:
            while np.count_nonzero(image >> bits) > SETTINGS.bright_share * image.size:
                bits += 1
    return bits


def to_uint8(image: Grey, bits: int) -> NDArray[np.uint8]:
    """Scale a 16-bit image (h, w), of which `bits` bits are used, to 8 bits; return an 8-bit image unchanged.

    A camera of 10 or 12 bits uses the lower bits of its 16: dividing by 256 would leave it nearly black.
    """
    if image.dtype == np.uint16:
        return np.minimum(image >> (bits - 8), 255).astype(np.uint8)
    return image.astype(np.uint8, copy=False)


class GreyScaler:
    """Scales a log's images to 8 bits by the brightest so far of both cameras, so that brightness does not jump."""

    def __init__(self) -> None:
        self._bits = FEWEST_BITS

    def to_uint8(self, *images: Grey) -> list[NDArray[np.uint8]]:
        """Scale the images (h, w) of the next frame; frames must come in order, because the scale is remembered."""
        self._bits = max(self._bits, bits_used(*images))
        return [to_uint8(image, self._bits) for image in images]


def image_problem(image: object) -> str:
    """Return why an array is not an image, with the form to give instead, or an empty string."""
    if not isinstance(image, np.ndarray):
        return f"is {described(image)}; give a NumPy array, such as np.asarray(image)"
    if image.dtype.kind == "f":
        scaled = "np.rint(255 * image).astype(np.uint8)"
        return f"is {image.dtype}; give uint8 or uint16, of values from 0 to 1 with {scaled}"
    if image.dtype not in (np.uint8, np.uint16):
        return f"is {image.dtype}; give uint8, or uint16 with image.astype(np.uint16)"
    if image.ndim == 3 and image.shape[0] in (1, 3, 4) and image.shape[2] not in (1, 3, 4):
        return f"has shape {image.shape}, with the channels first; give image.transpose(1, 2, 0)"
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (1, 3, 4)):
        return f"has shape {image.shape}; give (h, w), or colour with blue first: (h, w, 3) or (h, w, 4)"
    return ""


def to_grey(image: NDArray[np.generic]) -> Grey:
    """Return the grey image (h, w) of a valid one: (h, w), (h, w, 1), or colour with blue first; 8 or 16 bits."""
    pixels = np.asarray(image)
    if pixels.ndim == 3 and pixels.shape[2] == 1:
        pixels = pixels[:, :, 0]
    pixels = np.ascontiguousarray(pixels)  # for example, half of a wider image is not
    if pixels.ndim == 3:
        pixels = cv2.cvtColor(pixels, _TO_GREY[pixels.shape[2]])
    return np.asarray(pixels)
