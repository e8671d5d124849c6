"""ORB-SLAM's settings (YAML of OpenCV): Camera1, Camera2 and Stereo.T_c1_c2 of version 3, or a rectified pair.

Of a rectified pair the baseline is Camera.bf over the focal length, or Stereo.b. T_c1_c2 carries points of the right
camera into the left one.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...geometry import se3
from ..models import Camera
from .document import Document, Pair, Size

NAME = "ORB-SLAM settings (YAML)"
FILES = 1
_COEFFICIENTS = {"PinHole": ("k1", "k2", "p1", "p2", "k3"), "KannalaBrandt8": ("k1", "k2", "k3", "k4")}
_LENSES = {"PinHole": "plumb_bob", "KannalaBrandt8": "equidistant", "Rectified": "none"}


def matches(data: Mapping[str, Any]) -> bool:
    """Whether the content of a file are ORB-SLAM's settings."""
    return "Camera1.fx" in data or ("Camera.fx" in data and "Camera.bf" in data)


def pair(documents: Sequence[Document], size: Size | None) -> Pair:
    """The pair of one file."""
    (document,) = documents
    first = left(documents, size)
    if "Stereo.T_c1_c2" in document.data:
        right = _camera(document, "Camera2", size)
        return (
            first,
            right,
            np.asarray(se3.inverse(document.pose(document.data["Stereo.T_c1_c2"], "Stereo.T_c1_c2"))),
        )
    if "Stereo.b" in document.data:
        baseline_m = _number(document, "Stereo.b")
    elif "Camera.bf" in document.data:
        baseline_m = _number(document, "Camera.bf") / first.K[0, 0]
    else:
        raise document.error("Stereo.T_c1_c2 (or Stereo.b, Camera.bf), the pose of the right camera, is missing")
    rectified = Camera(first.width, first.height, first.K, (), "none")
    return rectified, rectified, se3.exp([-baseline_m, 0, 0, 0, 0, 0])


def left(documents: Sequence[Document], size: Size | None) -> Camera:
    """The left camera."""
    document = documents[0]
    return _camera(document, "Camera1" if "Camera1.fx" in document.data else "Camera", size)


def _camera(document: Document, name: str, size: Size | None) -> Camera:
    data = document.data
    if "Camera.width" in data and "Camera.height" in data:
        size = (int(_number(document, "Camera.width")), int(_number(document, "Camera.height")))
    if size is None:
        raise document.error("Camera.width and Camera.height are missing", "size")
    fx, fy, cx, cy = (_number(document, f"{name}.{key}") for key in ("fx", "fy", "cx", "cy"))
    model = str(data.get("Camera.type", "PinHole"))
    if model not in _LENSES:
        raise document.error(f"Camera.type {model!r} is not supported; supported are {', '.join(_LENSES)}")
    keys = [f"{name}.{key}" for key in _COEFFICIENTS.get(model, ())]
    coefficients = [_number(document, key) if key in data else 0.0 for key in keys]
    return document.camera(size, np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), _LENSES[model], coefficients)


def _number(document: Document, key: str) -> float:
    return float(document.numbers(document.data.get(key), key, ()))
