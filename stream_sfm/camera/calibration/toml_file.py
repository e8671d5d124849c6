"""The calibration file of this package: one or two cameras as TOML, written by hand or by `text`.

    [left]
    width = 752                     # pixels
    height = 480
    K = [[458.654, 0.0, 367.215],   # pixels; or fx, fy, cx, cy instead of K
         [0.0, 457.296, 248.375],
         [0.0, 0.0, 1.0]]
    distortion_model = "plumb_bob"  # none, plumb_bob (k1 k2 p1 p2 [k3]), rational_polynomial (8), equidistant (4)
    D = [-0.283, 0.074, 0.00019, 1.76e-05]   # may be left out

    [right]                         # the same keys
    ...

    [right_from_left]               # carries points of the left camera into the right one
    rotation = [[1.0, 0.0, 0.0],    # 3×3, rows; may be left out for parallel cameras
                [0.0, 1.0, 0.0],
                [0.0, 0.0, 1.0]]
    translation_m = [-0.11, 0.0, 0.0]   # metres; the first number is −baseline for parallel cameras

    [refinement]                    # written by `stream-sfm calibrate`; may be left out
    error_px = [0.14, …]            # thirteen errors of the calibration (`camera/refinement.py`)
    covariance_px2 = [[…], …]       # 13×13

Instead of [right_from_left], `right_from_left = [[…], […], […], [0, 0, 0, 1]]` (4×4, metres) may stand at the top. For
one camera (`Config.mono`) the first section is enough.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import ConfigError
from ...geometry import se3
from ...geometry.se3 import Array
from ..models import Camera
from ..refinement import TERMS, Refinement
from .document import Document, Pair, Size

NAME = "TOML of stream_sfm"
FILES = 1
_SECTIONS = {"left", "right", "right_from_left", "refinement"}
_CAMERA_KEYS = {"width", "height", "K", "fx", "fy", "cx", "cy", "distortion_model", "D"}


def matches(data: Mapping[str, Any]) -> bool:
    """Whether the content of a file are the sections of this format."""
    return bool(set(data) & _SECTIONS)


def pair(documents: Sequence[Document], size: Size | None) -> Pair:
    """The pair of one file."""
    name, data = _sections(documents[0])
    cameras = _camera(name, data, "left"), _camera(name, data, "right"), _right_from_left(name, data)
    return (*cameras, _refinement(name, data["refinement"])) if "refinement" in data else cameras


def left(documents: Sequence[Document], size: Size | None) -> Camera:
    """The left camera alone; the file need not have another."""
    return _camera(*_sections(documents[0]), "left")


def text(
    cameras: Mapping[str, Camera], right_from_left: Array | None = None, refinement: Refinement | None = None
) -> str:
    """Cameras by name as text that is read back unchanged; of a pair the pose of the right one, and known errors."""
    lines = ["# calibration: pixels and metres"]
    for name, camera in cameras.items():
        lines += ["", f"[{name}]", f"width = {camera.width}", f"height = {camera.height}"]
        lines += [f"K = {camera.K.tolist()}", f'distortion_model = "{camera.distortion_model}"']
        lines += [f"D = {list(camera.D)}"]
    if right_from_left is not None:
        lines += ["", "[right_from_left]", f"rotation = {right_from_left[:3, :3].tolist()}"]
        lines += [f"translation_m = {right_from_left[:3, 3].tolist()}"]
    if refinement is not None:
        lines += ["", f"[refinement]  # terms: {', '.join(TERMS)}", f"error_px = {refinement.error_px.tolist()}"]
        lines += ["covariance_px2 = [", *(f"    {row}," for row in refinement.cov_px2.tolist()), "]"]
    return "\n".join(lines) + "\n"


def _sections(document: Document) -> tuple[str, Mapping[str, Any]]:
    _known(document.name, "the top", document.data, _SECTIONS)
    return document.name, document.data


def _known(path: str | Path, where: str, table: Mapping[str, Any], known: set[str]) -> None:
    unknown = sorted(set(table) - known)
    if unknown:
        raise ConfigError(
            f"calibration {path}: unknown key {unknown[0]!r} at {where}; known are {', '.join(sorted(known))}"
        )


def _camera(path: str | Path, data: Mapping[str, Any], name: str) -> Camera:
    table = data.get(name)
    if not isinstance(table, dict):
        raise ConfigError(f"calibration {path}: section [{name}] is missing")
    where = f"calibration {path}: {name}"
    _known(path, f"[{name}]", table, _CAMERA_KEYS)
    size = []
    for key in ("width", "height"):
        value = table.get(key)
        if not isinstance(value, int) or isinstance(value, bool):
            raise ConfigError(f"{where}.{key} must be a whole number of pixels, got {value!r}")
        size.append(value)
    if "K" in table:
        if {"fx", "fy", "cx", "cy"} & set(table):
            raise ConfigError(f"{where}: give either K or fx, fy, cx, cy, not both")
        k = _numbers(f"{where}.K", table["K"], (3, 3))
    else:
        fx, fy, cx, cy = (float(_numbers(f"{where}.{key}", table.get(key), ())) for key in ("fx", "fy", "cx", "cy"))
        k = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    d = _numbers(f"{where}.D", table.get("D", []), None)
    model = table.get("distortion_model", "plumb_bob" if d.any() else "none")
    if not isinstance(model, str):
        raise ConfigError(f"{where}.distortion_model must be a name in quotes, got {model!r}")
    try:
        return Camera(size[0], size[1], k, tuple(d), model)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None


def _right_from_left(path: str | Path, data: Mapping[str, Any]) -> Array:
    value = data.get("right_from_left")
    where = f"calibration {path}: right_from_left"
    if value is None:
        raise ConfigError(
            f"{where} is missing: give rotation and translation_m of the right camera, or a 4×4 matrix"
        )
    if not isinstance(value, dict):
        return _numbers(where, value, (4, 4))
    _known(path, "[right_from_left]", value, {"rotation", "translation_m"})
    rotation = _numbers(f"{where}.rotation", value.get("rotation", np.eye(3).tolist()), (3, 3))
    translation = _numbers(f"{where}.translation_m", value.get("translation_m"), (3,))
    return se3.from_rotation_translation(rotation, translation)


def _refinement(path: str | Path, table: Any) -> Refinement:
    where = f"calibration {path}: refinement"
    if not isinstance(table, dict):
        raise ConfigError(f"{where} must be a section with error_px and covariance_px2, got {table!r}")
    _known(path, "[refinement]", table, {"error_px", "covariance_px2"})
    n = len(TERMS)
    error = _numbers(f"{where}.error_px", table.get("error_px"), (n,))
    cov = _numbers(f"{where}.covariance_px2", table.get("covariance_px2"), (n, n))
    try:
        return Refinement(error, cov)
    except ConfigError as error_of_it:
        raise ConfigError(f"{where}: {error_of_it}") from None


def _numbers(where: str, value: Any, shape: tuple[int, ...] | None) -> Array:
    """Finite numbers of one shape (None: a list of any length); strings and booleans are no numbers."""
    kind = "a list of numbers" if shape is None else "a number"
    if shape:
        kind = f"{'×'.join(map(str, shape))} numbers"
    try:
        array = np.array(value)
    except ValueError:  # rows of different length
        array = np.array(None)
    shape_fits = array.ndim == 1 if shape is None else array.shape == shape
    if (
        not shape_fits
        or not (array.dtype.kind in "iuf" or array.size == 0)
        or not np.isfinite(array.astype(float)).all()
    ):
        raise ConfigError(f"{where} must be {kind}, finite, got {value!r}")
    return array.astype(float)
