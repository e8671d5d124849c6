"""KITTI's projections of four rectified cameras, P = K [I | t] from camera 0: P0 … P3 of the odometry's calib.txt, and
P_rect_00 … of the raw data's calib_cam_to_cam.txt.

The file does not tell the size of the images; it comes from the images.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...geometry import se3
from ...geometry.se3 import Array
from ..models import Camera
from .document import Document, Pair, Size

NAME = "KITTI calib.txt, calib_cam_to_cam.txt"
FILES = 1


def matches(data: Mapping[str, Any]) -> bool:
    """Whether the content of a file are projections."""
    return bool(_key(data, 0) or (_key(data, 2) and _key(data, 3)))


def pair(documents: Sequence[Document], size: Size | None) -> Pair:
    """The pair of the grey cameras (0, 1), or of the colour cameras (2, 3) where these alone are in the file."""
    (document,) = documents
    return pair_of(document, (0, 1) if _key(document.data, 0) and _key(document.data, 1) else (2, 3), size)


def left(documents: Sequence[Document], size: Size | None) -> Camera:
    """Camera 0, or 2 where it is the first in the file."""
    return _camera(documents[0], 0 if _key(documents[0].data, 0) else 2, size)


def pair_of(document: Document, cameras: tuple[int, int], size: Size | None) -> Pair:
    """The pair of two of the four cameras. Raises ConfigError."""
    left_from_cam0, right_from_cam0 = (cam_from_cam0(document, n) for n in cameras)
    pose = se3.from_rotation_translation(np.eye(3), right_from_cam0 - left_from_cam0)
    return _camera(document, cameras[0], size), _camera(document, cameras[1], size), np.asarray(pose)


def cam_from_cam0(document: Document, number: int) -> Array:
    """The translation (3,) of camera `number` from camera 0, metres. Raises ConfigError."""
    p = _projection(document, number)
    try:
        return np.asarray(np.linalg.solve(p[:, :3], p[:, 3]), dtype=float)
    except np.linalg.LinAlgError:
        raise document.error(f"P{number} is not a projection matrix: {p.tolist()}") from None


def _key(data: Mapping[str, Any], number: int) -> str:
    """The name of the projection of a camera; empty where it is not there."""
    return next((name for name in (f"P{number}", f"P_rect_0{number}") if name in data), "")


def _projection(document: Document, number: int) -> Array:
    row = document.data.get(_key(document.data, number))
    if row is None:
        raise document.error(f"P{number} is missing: it is the calibration of image_{number}")
    return document.numbers(row, f"P{number}", (3, 4))


def _camera(document: Document, number: int, size: Size | None) -> Camera:
    if size is None:
        raise document.error("the format does not tell the size of the images: use it with a recording")
    return document.camera(size, _projection(document, number)[:, :3], "none", ())
