"""The calibration file of this package: one or two cameras as TOML, written by hand or by `text`.

docs/own-data.md shows a complete one, docs/formats.md has all keys.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

import numpy as np

from ...geometry import Array, se3
from ...inertial.samples import ImuCalibration
from ..models import Camera
from ..refinement import LENS_TERMS, KnownTiming, Refinement
from . import inertial
from .document import Document, Format, Size, camera_matrix

_SECTIONS = ("left", "right", "right_from_left", "refinement", "timing", "imu")
_CAMERA_KEYS = ("width", "height", "K", "fx", "fy", "cx", "cy", "distortion_model", "D")
_TIMING_KEYS = tuple(field.name for field in fields(KnownTiming))


def text(
    cameras: Mapping[str, Camera],
    right_from_left: Array | None = None,
    refinement: Refinement | None = None,
    timing: KnownTiming | None = None,
    imu: ImuCalibration | None = None,
) -> str:
    """Return cameras by name, and for a pair its pose, known errors and IMU, as text that is read back unchanged."""
    lines = ["# calibration: pixels and metres"]
    for name, camera in cameras.items():
        lines += ["", f"[{name}]", f"width = {camera.width}", f"height = {camera.height}"]
        lines += [f"K = {camera.K.tolist()}", f'distortion_model = "{camera.distortion_model}"']
        lines += [f"D = {list(camera.D)}"]
    if right_from_left is not None:
        lines += ["", "[right_from_left]", f"rotation = {right_from_left[:3, :3].tolist()}"]
        lines += [f"translation_m = {right_from_left[:3, 3].tolist()}"]
    if refinement is not None:
        lines += ["", f"[refinement]  # terms: {', '.join(LENS_TERMS)}"]
        lines += [f"error_px = {refinement.error_px.tolist()}"]
        lines += ["covariance_px2 = [", *(f"    {row}," for row in refinement.cov_px2.tolist()), "]"]
    if timing is not None:
        lines += ["", "[timing]", *(f"{name} = {value!r}" for name, value in asdict(timing).items())]
    if imu is not None:
        lines += inertial.lines(imu)
    return "\n".join(lines) + "\n"


def _camera(document: Document, side: int, size: Size | None) -> Camera:
    _check_keys(document, "the top", document.data, _SECTIONS)
    name = _SECTIONS[side]
    if (table := _section(document, name, _CAMERA_KEYS)) is None:
        raise document.error(f"section [{name}] is missing")
    for key in ("width", "height"):
        if not isinstance(value := table.get(key), int) or isinstance(value, bool):
            raise document.error(f"{name}.{key} must be a whole number of pixels, got {value!r}")
    if "K" in table:
        if {"fx", "fy", "cx", "cy"} & set(table):
            raise document.error(f"{name}: give either K or fx, fy, cx, cy, not both")
        k = document.numbers(table["K"], f"{name}.K", (3, 3))
    else:
        k = camera_matrix(*(document.number(table.get(key), f"{name}.{key}") for key in ("fx", "fy", "cx", "cy")))
    d = document.numbers(table.get("D", []), f"{name}.D", None)
    model = table.get("distortion_model", "plumb_bob" if d.any() else "none")
    if not isinstance(model, str):
        raise document.error(f"{name}.distortion_model must be a name in quotes, got {model!r}")
    with document.naming(name):
        return Camera(table["width"], table["height"], k, tuple(d), model)


def _pose(document: Document, _: Document, _size: Size | None) -> Array:
    name, value = "right_from_left", document.data.get("right_from_left")
    if value is None:
        raise document.error(f"{name} is missing: give rotation and translation_m, or a 4×4 matrix")
    if not isinstance(value, dict):
        return document.numbers(value, name, (4, 4))
    _check_keys(document, f"[{name}]", value, ("rotation", "translation_m"))
    rotation = document.numbers(value.get("rotation", np.eye(3).tolist()), f"{name}.rotation", (3, 3))
    translation = document.numbers(value.get("translation_m"), f"{name}.translation_m", (3,))
    return se3.from_rotation_translation(rotation, translation)


def _known(document: Document) -> tuple[Refinement | None, KnownTiming | None]:
    refinement = timing = None
    if (table := _section(document, "refinement", ("error_px", "covariance_px2"))) is not None:
        n = len(LENS_TERMS)
        error = document.numbers(table.get("error_px"), "refinement.error_px", (n,))
        cov = document.numbers(table.get("covariance_px2"), "refinement.covariance_px2", (n, n))
        with document.naming("refinement"):
            refinement = Refinement(error, cov)
    if (table := _section(document, "timing", _TIMING_KEYS)) is not None:
        values = [document.number(table.get(key), f"timing.{key}") for key in _TIMING_KEYS]
        with document.naming("timing"):
            timing = KnownTiming(*values)
    return refinement, timing


def _section(document: Document, name: str, keys: Sequence[str]) -> dict[str, Any] | None:
    """Return a section with some of these keys; None if it is missing."""
    if (table := document.data.get(name)) is None:
        return None
    if not isinstance(table, dict):
        raise document.error(f"{name} must be a section with {', '.join(keys)}, got {table!r}")
    _check_keys(document, f"[{name}]", table, keys)
    return table


def _check_keys(document: Document, where: str, table: Mapping[str, Any], known: Sequence[str]) -> None:
    if unknown := sorted(set(table) - set(known)):
        raise document.error(f"unknown key {unknown[0]!r} at {where}; known are {', '.join(sorted(known))}")


def _is_own(data: Mapping[str, Any]) -> bool:
    return not set(data).isdisjoint(_SECTIONS)


TOML = Format("TOML of stream_sfm", 1, _is_own, _camera, _pose, _known, inertial.of_toml)
