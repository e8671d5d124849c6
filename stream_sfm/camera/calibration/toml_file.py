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

    [refinement]                    # may be left out
    error_px = [0.14, …]            # thirteen errors of the calibration (`camera/refinement.py`)
    covariance_px2 = [[…], …]       # 13×13

    [timing]                        # of the cameras, as far as it is known; may be left out
    delay_s = 0.0081                # by which the right image is exposed later than the left one
    std_delay_s = 0.0002            # its σ
    readout_s = 0.019               # in which rolling shutters read out an image, from the top down
    std_readout_s = 0.001

Instead of [right_from_left], `right_from_left = [[…], […], […], [0, 0, 0, 1]]` (4×4, metres) may stand at the top. For
one camera (`Config.mono`) the first section is enough.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

import numpy as np

from ...errors import ConfigError
from ...geometry import se3
from ...geometry.se3 import Array
from ..known_timing import KnownTiming
from ..models import Camera
from ..refinement import TERMS, Refinement
from .document import Document, Pair, Size

NAME = "TOML of stream_sfm"
FILES = 1
_SECTIONS = {"left", "right", "right_from_left", "refinement", "timing"}
_CAMERA_KEYS = {"width", "height", "K", "fx", "fy", "cx", "cy", "distortion_model", "D"}


def matches(data: Mapping[str, Any]) -> bool:
    """Whether the content of a file are the sections of this format."""
    return bool(set(data) & _SECTIONS)


def pair(documents: Sequence[Document], size: Size | None) -> Pair:
    """The pair of one file."""
    document = _checked(documents[0])
    cameras = _camera(document, "left"), _camera(document, "right"), _right_from_left(document)
    return *cameras, _refinement(document), _timing(document)


def left(documents: Sequence[Document], size: Size | None) -> Camera:
    """The left camera alone; the file need not have another."""
    return _camera(_checked(documents[0]), "left")


def text(
    cameras: Mapping[str, Camera],
    right_from_left: Array | None = None,
    refinement: Refinement | None = None,
    timing: KnownTiming | None = None,
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
    if timing is not None:
        lines += ["", "[timing]", *(f"{name} = {value!r}" for name, value in asdict(timing).items())]
    return "\n".join(lines) + "\n"


def _checked(document: Document) -> Document:
    _known(document, "the top", document.data, _SECTIONS)
    return document


def _known(document: Document, where: str, table: Mapping[str, Any], known: set[str]) -> None:
    if unknown := sorted(set(table) - known):
        raise document.error(f"unknown key {unknown[0]!r} at {where}; known are {', '.join(sorted(known))}")


def _camera(document: Document, name: str) -> Camera:
    table = document.data.get(name)
    if not isinstance(table, dict):
        raise document.error(f"section [{name}] is missing")
    _known(document, f"[{name}]", table, _CAMERA_KEYS)
    size = []
    for key in ("width", "height"):
        value = table.get(key)
        if not isinstance(value, int) or isinstance(value, bool):
            raise document.error(f"{name}.{key} must be a whole number of pixels, got {value!r}")
        size.append(value)
    if "K" in table:
        if {"fx", "fy", "cx", "cy"} & set(table):
            raise document.error(f"{name}: give either K or fx, fy, cx, cy, not both")
        k = document.numbers(table["K"], f"{name}.K", (3, 3))
    else:
        fx, fy, cx, cy = (
            float(document.numbers(table.get(key), f"{name}.{key}", ())) for key in ("fx", "fy", "cx", "cy")
        )
        k = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    d = document.numbers(table.get("D", []), f"{name}.D", None)
    model = table.get("distortion_model", "plumb_bob" if d.any() else "none")
    if not isinstance(model, str):
        raise document.error(f"{name}.distortion_model must be a name in quotes, got {model!r}")
    try:
        return Camera(size[0], size[1], k, tuple(d), model)
    except ConfigError as error:
        raise document.error(f"{name}: {error}") from None


def _right_from_left(document: Document) -> Array:
    name, value = "right_from_left", document.data.get("right_from_left")
    if value is None:
        raise document.error(
            f"{name} is missing: give rotation and translation_m of the right camera, or a 4×4 matrix"
        )
    if not isinstance(value, dict):
        return document.numbers(value, name, (4, 4))
    _known(document, f"[{name}]", value, {"rotation", "translation_m"})
    rotation = document.numbers(value.get("rotation", np.eye(3).tolist()), f"{name}.rotation", (3, 3))
    translation = document.numbers(value.get("translation_m"), f"{name}.translation_m", (3,))
    return se3.from_rotation_translation(rotation, translation)


def _timing(document: Document) -> KnownTiming | None:
    table = document.data.get("timing")
    if table is None:
        return None
    names = [field.name for field in fields(KnownTiming)]
    if not isinstance(table, dict):
        raise document.error(f"timing must be a section with {', '.join(names)}, got {table!r}")
    _known(document, "[timing]", table, set(names))
    try:
        return KnownTiming(*(float(document.numbers(table.get(name), f"timing.{name}", ())) for name in names))
    except ConfigError as problem:
        raise document.error(f"timing: {problem}") from None


def _refinement(document: Document) -> Refinement | None:
    table = document.data.get("refinement")
    if table is None:
        return None
    if not isinstance(table, dict):
        raise document.error(f"refinement must be a section with error_px and covariance_px2, got {table!r}")
    _known(document, "[refinement]", table, {"error_px", "covariance_px2"})
    n = len(TERMS)
    error = document.numbers(table.get("error_px"), "refinement.error_px", (n,))
    cov = document.numbers(table.get("covariance_px2"), "refinement.covariance_px2", (n, n))
    try:
        return Refinement(error, cov)
    except ConfigError as problem:
        raise document.error(f"refinement: {problem}") from None
