"""ROS's camera_info files: one YAML file per camera, as camera_calibration and camera_info_manager write them.

P belongs to the rectified images: P[3] = −f·baseline for the right camera. R turns camera axes into rectified
axes. So a point X of the left camera is in the right one R_rᵀ (R_l X + t) with t = (Tx, Ty, 0), Tx = P[3]/P[0].
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...geometry import se3
from ...geometry.se3 import Array
from ..models import Camera
from .document import Document, Pair, Size

NAME = "ROS camera_info (YAML)"
FILES = 2


def matches(data: Mapping[str, Any]) -> bool:
    """Whether the content of a file is a camera_info."""
    return "camera_matrix" in data and ("image_width" in data or "projection_matrix" in data)


def pair(documents: Sequence[Document], size: Size | None) -> Pair:
    """The pair of two files, left and right."""
    left, right = documents
    r_left, p_left = _rectification(left)
    r_right, p_right = _rectification(right)
    if not gives_baseline(p_left, p_right):
        raise right.error(
            "projection_matrix of neither camera contains the baseline (P[3] = −fx·baseline of the right one): "
            "calibrate both cameras as a pair"
        )
    pose = pose_from_projections(r_left, p_left, r_right, p_right)
    return _camera(left, size), _camera(right, size), pose


def left(documents: Sequence[Document], size: Size | None) -> Camera:
    """The camera of the first file."""
    return _camera(documents[0], size)


def gives_baseline(p_left: Array, p_right: Array) -> bool:
    """Whether P (3, 4) of both cameras is filled in and contains the baseline."""
    filled = all(p[0, 0] > 0 and p[1, 1] > 0 for p in (p_left, p_right))
    return filled and bool((_offset(p_right) != _offset(p_left)).any())


def pose_from_projections(r_left: Array, p_left: Array, r_right: Array, p_right: Array) -> Array:
    """`right_from_left` (4, 4), metres, of the rectifying rotations R (3, 3) and projections P (3, 4)."""
    offset = _offset(p_right) - _offset(p_left)
    return se3.from_rotation_translation(r_right.T @ r_left, r_right.T @ offset)


def _offset(p: Array) -> Array:
    return np.array([p[0, 3] / p[0, 0], p[1, 3] / p[1, 1], 0.0])


def _rectification(document: Document) -> tuple[Array, Array]:
    data = document.data
    rotation = document.rotation(data.get("rectification_matrix", np.eye(3)), "rectification_matrix")
    rotation = np.asarray(se3.orthonormalise(se3.from_rotation_translation(rotation, np.zeros(3))))[:3, :3]
    return rotation, document.numbers(data.get("projection_matrix"), "projection_matrix", (3, 4))


def _camera(document: Document, size: Size | None) -> Camera:
    data = document.data
    if "image_width" in data and "image_height" in data:
        width, height = (document.numbers(data[f"image_{k}"], f"image_{k}", ()) for k in ("width", "height"))
        size = (int(width), int(height))
    if size is None:
        raise document.error("image_width and image_height are missing")
    d = document.numbers(data.get("distortion_coefficients", []), "distortion_coefficients", None)
    k = document.numbers(data["camera_matrix"], "camera_matrix", (3, 3))
    return document.camera(size, k, data.get("distortion_model", "plumb_bob"), d.tolist())
