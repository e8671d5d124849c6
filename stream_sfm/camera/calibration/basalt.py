"""Basalt's calibration (JSON): poses of all cameras in the IMU's axes, and lenses by name."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...geometry import se3
from ...geometry.se3 import Array
from ..models import Camera
from .document import Document, Pair, Size
from .lenses import MODELS, nearest_fisheye

NAME = "Basalt calibration (JSON)"
FILES = 1
_LENSES = {  # names of lenses that a Camera has -> its own, and the coefficients in their order
    "pinhole": ("none", ()),
    "kb4": ("equidistant", ("k1", "k2", "k3", "k4")),
    "pinhole-radtan8": ("rational_polynomial", ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
}


def matches(data: Mapping[str, Any]) -> bool:
    """Whether the content of a file is Basalt's."""
    inside = data.get("value0", data)
    return isinstance(inside, Mapping) and {"T_imu_cam", "intrinsics", "resolution"} <= set(inside)


def pair(documents: Sequence[Document], size: Size | None) -> Pair:
    """The first two cameras."""
    (document,) = documents
    imu_from_cams = [_imu_from_cam(document, n) for n in (0, 1)]
    return _camera(document, 0), _camera(document, 1), np.asarray(se3.inverse(imu_from_cams[1]) @ imu_from_cams[0])


def left(documents: Sequence[Document], size: Size | None) -> Camera:
    """The first camera."""
    return _camera(documents[0], 0)


def _entry(document: Document, key: str, n: int) -> Any:
    entries = document.data.get("value0", document.data)[key]
    if not isinstance(entries, list) or len(entries) <= n:
        raise document.error(f"{key}[{n}] is missing: a pair needs two cameras")
    return entries[n]


def _imu_from_cam(document: Document, n: int) -> Array:
    entry = _entry(document, "T_imu_cam", n)
    names = ("px", "py", "pz", "qx", "qy", "qz", "qw")
    numbers = document.numbers([_in(entry, name) for name in names], f"T_imu_cam[{n}]", (7,))
    return se3.from_rotation_translation(se3.matrix_from_quat_xyzw(numbers[3:]), numbers[:3])


def _camera(document: Document, n: int) -> Camera:
    entry, where = _entry(document, "intrinsics", n), f"intrinsics[{n}]."
    model, values = str(_in(entry, "camera_type")), _in(entry, "intrinsics")
    if model not in {**_LENSES, **MODELS}:
        raise document.error(
            f"{where}camera_type {model!r} is not supported; supported are {', '.join([*_LENSES, *MODELS])}"
        )
    width, height = document.numbers(_entry(document, "resolution", n), f"resolution[{n}]", (2,))
    size = (int(width), int(height))

    def number(name: str) -> float:
        return float(document.numbers(_in(values, name), f"{where}{name}", ()))

    k = np.array([[number("fx"), 0, number("cx")], [0, number("fy"), number("cy")], [0, 0, 1]])
    if model in MODELS:
        named = {name: number(name) for name in MODELS[model][0]}
        return nearest_fisheye(document, where, model, size, k, named, np.zeros(0))
    lens, names = _LENSES[model]
    return document.camera(size, k, lens, [number(name) for name in names])


def _in(table: Any, key: str) -> Any:
    return table.get(key) if isinstance(table, Mapping) else None
