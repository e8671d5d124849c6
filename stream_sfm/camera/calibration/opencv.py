"""OpenCV's FileStorage (YAML, XML or JSON) with what stereoCalibrate or stereoRectify return, in one file or two.

The names are those of OpenCV's samples (M1, D1, M2, D2, R, T; R1, R2, P1, P2) and of its documentation (cameraMatrix1,
distCoeffs1 …), upper and lower case and underscores ignored. T is in the unit of the calibration board: metres here.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...geometry import se3
from ...geometry.se3 import Array
from ..models import Camera
from . import ros
from .document import Document, Pair, Size

NAME = "OpenCV FileStorage of stereoCalibrate"
FILES = 0  # one or two: intrinsics.yml and extrinsics.yml
_SIDES = (("1", "l", "left"), ("2", "r", "right"))
_MATRIX, _DISTORTION = (
    ("m", "k", "cm", "mtx", "cameramatrix", "intrinsics"),
    ("d", "dist", "distcoeffs", "distortion"),
)
_SIZE = ("imagesize", "size", "framesize", "resolution")


def matches(data: Mapping[str, Any]) -> bool:
    """Whether the content of a file is of a stereo calibration."""
    keys = set(_normalised(data))
    return bool({"m1", "k1", "cm1", "cameramatrix1"} & keys or {"r", "t"} <= keys or {"p1", "p2"} <= keys) or any(
        f"{matrix}{side}" in keys for matrix in _MATRIX for side in ("left", "l")
    )


def pair(documents: Sequence[Document], size: Size | None) -> Pair:
    """The pair of all files together."""
    document = _merged(documents)
    return _camera(document, 0, size), _camera(document, 1, size), _right_from_left(document)


def left(documents: Sequence[Document], size: Size | None) -> Camera:
    """The first camera."""
    return _camera(_merged(documents), 0, size)


def _merged(documents: Sequence[Document]) -> Document:
    data: dict[str, Any] = {}
    for document in documents:
        data |= _normalised(document.data)
    return Document(" and ".join(document.name for document in documents), data)


def _normalised(data: Mapping[str, Any]) -> dict[str, Any]:
    return {re.sub(r"[_\s.-]", "", key).lower(): value for key, value in data.items() if isinstance(key, str)}


def _get(document: Document, names: Sequence[str], side: int) -> tuple[Any, str]:
    """The value of the first of these names that is there, with it, and `names[0]` where none is."""
    for name in names:
        for suffix in _SIDES[side]:
            for key in (f"{name}{suffix}", f"{suffix}{name}"):
                if key in document.data and not (len(key) == 2 and suffix in "lr"):  # "dr" may be anything
                    return document.data[key], key
    return None, f"{names[0]}{_SIDES[side][0]}".upper()


def _camera(document: Document, side: int, size: Size | None) -> Camera:
    k = document.numbers(*_get(document, _MATRIX, side), (3, 3))
    coefficients, name = _get(document, _DISTORTION, side)
    d = document.numbers(np.ravel(coefficients) if coefficients is not None else [], name, None)
    model = document.data.get("distortionmodel") or ("fisheye" if document.data.get("fisheye") else "plumb_bob")
    given = next((document.data[key] for key in _SIZE if key in document.data), None)
    if given is None and {"imagewidth", "imageheight"} <= set(document.data):
        given = [document.data["imagewidth"], document.data["imageheight"]]
    if given is not None:
        width, height = document.numbers(given, "image_size", (2,))
        size = (int(width), int(height))
    if size is None:
        raise document.error("the size of the images is missing: add image_width and image_height", "size")
    return document.camera(size, k, model, d.tolist())


def _right_from_left(document: Document) -> Array:
    data = document.data
    if "r" in data and "t" in data:
        rotation, translation = document.rotation(data["r"], "R"), document.numbers(data["t"], "T", (3,))
        return se3.orthonormalise(se3.from_rotation_translation(rotation, translation))
    if {"r1", "r2", "p1", "p2"} <= set(data):
        r = [document.rotation(data[f"r{n}"], f"R{n}") for n in (1, 2)]
        p = [document.numbers(data[f"p{n}"], f"P{n}", (3, 4)) for n in (1, 2)]
        if ros.gives_baseline(*p):
            return ros.pose_from_projections(r[0], p[0], r[1], p[1])
    raise document.error("R and T, the pose of the right camera, are missing (or R1, R2, P1 and P2)")
