"""Calibrations by the matrices K, R and P: ROS's camera_info, KITTI's projections, OpenCV's FileStorage.

P belongs to rectified images: P[3] = −f·baseline for the right camera. R turns camera axes into rectified axes. A
point X of the left camera is therefore R_rᵀ (R_l X + t) in the right one, with t = (Tx, Ty, 0), Tx = P[3]/P[0].
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...geometry import Array, se3
from ..models import Camera
from .document import Document, Format, Size

# The names in OpenCV's samples (M1, D1, M2, D2, R, T; R1, R2, P1, P2) and documentation (cameraMatrix1 …). Case and
# underscores are ignored.
_SIDES = (("1", "l", "left"), ("2", "r", "right"))
_MATRIX = ("m", "k", "cm", "mtx", "cameramatrix", "intrinsics")
_DISTORTION = ("d", "dist", "distcoeffs", "distortion")
_SIZE = ("imagesize", "size", "framesize", "resolution")


def gives_baseline(p_left: Array, p_right: Array) -> bool:
    """Whether P (3, 4) of both cameras is filled in and contains the baseline."""
    filled = all(p[0, 0] > 0 and p[1, 1] > 0 for p in (p_left, p_right))
    return filled and bool((_offset(p_right) != _offset(p_left)).any())


def pose_from_projections(r_left: Array, p_left: Array, r_right: Array, p_right: Array) -> Array:
    """Return `right_from_left` (4, 4), metres, from the rectifying rotations R (3, 3) and projections P (3, 4)."""
    offset = _offset(p_right) - _offset(p_left)
    return se3.from_rotation_translation(r_right.T @ r_left, r_right.T @ offset)


def _offset(p: Array) -> Array:
    return np.array([p[0, 3] / p[0, 0], p[1, 3] / p[1, 1], 0.0])


def _ros_camera(document: Document, side: int, size: Size | None) -> Camera:
    data = document.data
    if "image_width" in data and "image_height" in data:
        size = document.size([data["image_width"], data["image_height"]], "image_width and image_height")
    if size is None:
        raise document.error("image_width and image_height are missing")
    d = document.numbers(data.get("distortion_coefficients", []), "distortion_coefficients", None)
    k = document.numbers(data["camera_matrix"], "camera_matrix", (3, 3))
    return document.camera(size, k, data.get("distortion_model", "plumb_bob"), d.tolist())


def _ros_pose(left: Document, right: Document, _size: Size | None) -> Array:
    r, p = [], []
    for document in (left, right):
        rotation = document.rotation(document.data.get("rectification_matrix", np.eye(3)), "rectification_matrix")
        r.append(se3.orthonormalise(se3.from_rotation_translation(rotation, np.zeros(3)))[:3, :3])
        p.append(document.numbers(document.data.get("projection_matrix"), "projection_matrix", (3, 4)))
    if not gives_baseline(*p):
        baseline = "the baseline (P[3] = −fx·baseline of the right one): calibrate both cameras as a pair"
        raise right.error(f"projection_matrix of neither camera contains {baseline}")
    return pose_from_projections(r[0], p[0], r[1], p[1])


def kitti_camera(document: Document, number: int, size: Size | None) -> Camera:
    """Return one of KITTI's four cameras, rectified or not, depending on the image size. Raises ConfigError."""
    if size is None:
        raise document.error("the format does not contain the size of the images: use it with a recording")
    if _unrectified(document, number, size):
        k = document.numbers(document.data.get(f"K_0{number}"), f"K_0{number}", (3, 3))
        d = document.numbers(document.data.get(f"D_0{number}"), f"D_0{number}", (5,))
        return document.camera(size, k, "plumb_bob", d.tolist())
    return document.camera(size, _projection(document, number)[:, :3], "none", ())


def cam_from_cam0(document: Document, number: int, size: Size | None = None) -> Array:
    """Return the pose (4, 4) of KITTI's camera 0 in camera `number`, for images of this size. Raises ConfigError."""
    if _unrectified(document, number, size):
        rotation = document.rotation(document.data.get(f"R_0{number}"), f"R_0{number}")
        t = document.numbers(document.data.get(f"T_0{number}"), f"T_0{number}", (3,))
        return se3.orthonormalise(se3.from_rotation_translation(rotation, t))
    p = _projection(document, number)
    try:
        return se3.from_rotation_translation(np.eye(3), np.linalg.solve(p[:, :3], p[:, 3]))
    except np.linalg.LinAlgError:
        raise document.error(f"P{number} is not a projection matrix: {p.tolist()}") from None


def _unrectified(document: Document, number: int, size: Size | None) -> bool:
    """Whether images of this size are not rectified (`…_extract`); these are larger than rectified ones."""
    before, behind = (document.data.get(f"{name}_0{number}") for name in ("S", "S_rect"))
    if size is None or before is None or behind is None:
        return False
    return size == document.size(before, f"S_0{number}") != document.size(behind, f"S_rect_0{number}")


def _kitti_side(document: Document, side: int) -> int:
    """Return the number of a camera: grey, or colour if only these are in the file."""
    grey = _kitti_key(document.data, 0) and (_kitti_key(document.data, 1) or not _kitti_key(document.data, 2))
    return side if grey else 2 + side


def _kitti_pose(document: Document, _: Document, size: Size | None) -> Array:
    left, right = (cam_from_cam0(document, _kitti_side(document, side), size) for side in (0, 1))
    return right @ se3.inverse(left)


def _kitti_key(data: Mapping[str, Any], number: int) -> str:
    """Return the name of P = K [I | t] of a camera, in calib.txt or calib_cam_to_cam.txt; empty if it is missing."""
    return next((name for name in (f"P{number}", f"P_rect_0{number}") if name in data), "")


def _projection(document: Document, number: int) -> Array:
    row = document.data.get(_kitti_key(document.data, number))
    if row is None:
        raise document.error(f"P{number} is missing: it is the calibration of image_{number}")
    return document.numbers(row, f"P{number}", (3, 4))


def _opencv_camera(document: Document, side: int, size: Size | None) -> Camera:
    data = _normalised(document.data)
    k = document.numbers(*_get(data, _MATRIX, side), (3, 3))
    coefficients, name = _get(data, _DISTORTION, side)
    d = document.numbers(np.ravel(coefficients) if coefficients is not None else [], name, None)
    model = data.get("distortionmodel") or ("fisheye" if data.get("fisheye") else "plumb_bob")
    edges = [data[key] for key in ("imagewidth", "imageheight") if key in data]
    given = next((data[key] for key in _SIZE if key in data), edges if len(edges) == 2 else None)
    if given is not None:
        size = document.size(given, "image_size")
    if size is None:
        raise document.error("the size of the images is missing: add image_width and image_height", "size")
    return document.camera(size, k, model, d.tolist())


def _opencv_pose(document: Document, _: Document, _size: Size | None) -> Array:
    """Return the pose. T is in the unit of the calibration board, which is taken as metres here."""
    data = _normalised(document.data)
    if "r" in data and "t" in data:
        rotation, translation = document.rotation(data["r"], "R"), document.numbers(data["t"], "T", (3,))
        return se3.orthonormalise(se3.from_rotation_translation(rotation, translation))
    if {"r1", "r2", "p1", "p2"} <= set(data):
        r = [document.rotation(data[f"r{n}"], f"R{n}") for n in (1, 2)]
        p = [document.numbers(data[f"p{n}"], f"P{n}", (3, 4)) for n in (1, 2)]
        if gives_baseline(*p):
            return pose_from_projections(r[0], p[0], r[1], p[1])
    raise document.error("R and T, the pose of the right camera, are missing (or R1, R2, P1 and P2)")


def _normalised(data: Mapping[str, Any]) -> dict[str, Any]:
    return {re.sub(r"[_\s.-]", "", key).lower(): value for key, value in data.items() if isinstance(key, str)}


def _get(data: Mapping[str, Any], names: Sequence[str], side: int) -> tuple[Any, str]:
    """Return the first of these names that is present and its value, or `names[0]` if none is."""
    for name in names:
        for suffix in _SIDES[side]:
            for key in (f"{name}{suffix}", f"{suffix}{name}"):
                if key in data and not (len(key) == 2 and suffix in "lr"):  # "dr" may be anything
                    return data[key], key
    return None, f"{names[0]}{_SIDES[side][0]}".upper()


def _is_ros(data: Mapping[str, Any]) -> bool:
    return "camera_matrix" in data and ("image_width" in data or "projection_matrix" in data)


def _is_opencv(data: Mapping[str, Any]) -> bool:
    keys = set(_normalised(data))
    return bool({"m1", "k1", "cm1", "cameramatrix1"} & keys or {"r", "t"} <= keys or {"p1", "p2"} <= keys) or any(
        f"{matrix}{side}" in keys for matrix in _MATRIX for side in ("left", "l")
    )


ROS = Format("ROS camera_info (YAML)", 2, _is_ros, _ros_camera, _ros_pose)
KITTI = Format(
    "KITTI calib.txt, calib_cam_to_cam.txt",
    1,
    lambda data: bool(_kitti_key(data, 0) or (_kitti_key(data, 2) and _kitti_key(data, 3))),
    lambda document, side, size: kitti_camera(document, _kitti_side(document, side), size),
    _kitti_pose,
)
OPENCV = Format("OpenCV FileStorage of stereoCalibrate", 0, _is_opencv, _opencv_camera, _opencv_pose)
