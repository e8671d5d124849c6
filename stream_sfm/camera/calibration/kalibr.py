"""Kalibr's camchain: the cameras cam0, cam1, … of one YAML file, each with its pose from the one before."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...geometry import se3
from ...geometry.se3 import Array
from ..models import Camera
from .document import Document, Pair, Size
from .lenses import MODELS, nearest_fisheye

NAME = "Kalibr camchain (YAML)"
FILES = 1


def matches(data: Mapping[str, Any]) -> bool:
    """Whether the content of a file is a camchain."""
    return isinstance(data.get("cam0"), Mapping) and "intrinsics" in data["cam0"]


def pair(documents: Sequence[Document], size: Size | None) -> Pair:
    """The pair (cam0, cam1)."""
    (document,) = documents
    if not isinstance(document.data.get("cam1"), Mapping):
        raise document.error("cam1 is missing: a pair needs two cameras")
    return _camera(document, "cam0"), _camera(document, "cam1"), _right_from_left(document)


def left(documents: Sequence[Document], size: Size | None) -> Camera:
    """The camera cam0."""
    return _camera(documents[0], "cam0")


def body_from_left(document: Document) -> Array | None:
    """The pose (4, 4) of cam0 on the IMU, where the file tells it."""
    pose = (document.data.get("cam0") or {}).get("T_cam_imu")
    return None if pose is None else np.asarray(se3.inverse(document.pose(pose, "cam0.T_cam_imu")))


def _right_from_left(document: Document) -> Array:
    first, second = document.data["cam0"], document.data["cam1"]
    if "T_cn_cnm1" in second:
        return document.pose(second["T_cn_cnm1"], "cam1.T_cn_cnm1")
    if "T_cam_imu" in first and "T_cam_imu" in second:
        cams_from_imu = [document.pose(c["T_cam_imu"], f"cam{n}.T_cam_imu") for n, c in enumerate((first, second))]
        return cams_from_imu[1] @ se3.inverse(cams_from_imu[0])
    raise document.error("cam1.T_cn_cnm1, the pose of cam0 in cam1, is missing: calibrate both cameras together")


def _camera(document: Document, name: str) -> Camera:
    table, where = document.data[name], f"{name}."
    model = table.get("camera_model", "pinhole")
    if model not in MODELS:
        return document.pinhole(table, where, "distortion_coeffs", "none")
    if (lens := table.get("distortion_model", "none")) != "none" and not (model == "omni" and lens == "radtan"):
        raise document.error(f"{where}distortion_model {lens!r} of a {model} camera is not supported, only none")
    names = MODELS[model][0]
    numbers = document.numbers(table.get("intrinsics"), f"{where}intrinsics", (len(names) + 4,))
    width, height = document.numbers(table.get("resolution"), f"{where}resolution", (2,))
    d = document.numbers(table.get("distortion_coeffs") or [], f"{where}distortion_coeffs", None)
    fx, fy, cx, cy = numbers[len(names) :]
    k = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    values = dict(zip(names, numbers.tolist(), strict=False))
    return nearest_fisheye(document, where, model, (int(width), int(height)), k, values, d)
