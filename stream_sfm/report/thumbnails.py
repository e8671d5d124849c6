"""Small images for reports."""

import cv2
import numpy as np
from numpy.typing import NDArray


def jpeg(grey: NDArray[np.uint8], width: int, quality: int = 72) -> bytes:
    """Encode a grey image (h, w), reduced to at most `width` columns, as JPEG."""
    scale = min(1.0, width / grey.shape[1])
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else grey
    return bytes(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, quality])[1])
