"""Masks: pixels of a camera that never show the scene, because they show the robot or dirt on the lens."""

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import ConfigError, as_error
from ..system.inputs import LIMITS, read_small

Mask = NDArray[np.bool_]
_PNG, _HEADER_BYTES = b"\x89PNG\r\n\x1a\n", 24


def checked_mask(mask: object, width: int, height: int) -> Mask:
    """Return a mask (h, w), true where pixels show the scene, from an array of numbers. Raises ConfigError."""
    given = np.asarray(mask)
    seen = np.asarray(given.any(axis=2) if given.ndim == 3 else given != 0)
    if seen.shape != (height, width):
        raise ConfigError(f"the mask has shape {seen.shape}, but the images of its camera have ({height}, {width})")
    if not seen.any():
        raise ConfigError("the mask leaves no pixel: make it 0 (black) only where pixels are left out")
    seen.flags.writeable = False
    return seen


def read_mask(path: str | Path, width: int, height: int) -> Mask:
    """Read a PNG of a camera's size as a mask, black where pixels are left out. Raises ConfigError."""
    with as_error(ConfigError, f"cannot read the mask {path}", OSError):
        data = read_small(path, LIMITS.mask_bytes)
    if not data.startswith(_PNG) or len(data) < _HEADER_BYTES:
        raise ConfigError(f"the mask {path} is not a PNG: save it as one, black where pixels are left out")
    size = struct.unpack(">II", data[16:_HEADER_BYTES])  # before decoding: a header can ask for gigabytes
    if size != (width, height):
        problem = f"the mask {path} is {size[0]}×{size[1]}, but the images of its camera are {width}×{height}"
        raise ConfigError(f"{problem}: give one of the size of the images as recorded, not rectified")
    import cv2  # late, as most runs have no mask, and many commands no images

    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise ConfigError(f"the mask {path} is damaged: it cannot be decoded")
    with as_error(ConfigError, f"{path}", ConfigError):
        return checked_mask(image, width, height)
