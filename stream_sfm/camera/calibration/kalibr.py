"""Kalibr's camchain: the cameras cam0, cam1, … of one YAML file, each with its pose from the one before."""

from collections.abc import Mapping, Sequence
from typing import Any

from ...geometry import se3
from ...geometry.se3 import Array
from ..models import Camera
from .document import Document, Pair, Size

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


def _right_from_left(document: Document) -> Array:
    first, second = document.data["cam0"], document.data["cam1"]
    if "T_cn_cnm1" in second:
        return document.pose(second["T_cn_cnm1"], "cam1.T_cn_cnm1")
    if "T_cam_imu" in first and "T_cam_imu" in second:
        cams_from_imu = [document.pose(c["T_cam_imu"], f"cam{n}.T_cam_imu") for n, c in enumerate((first, second))]
        return cams_from_imu[1] @ se3.inverse(cams_from_imu[0])
    raise document.error("cam1.T_cn_cnm1, the pose of cam0 in cam1, is missing: calibrate both cameras together")


def _camera(document: Document, name: str) -> Camera:
    return document.pinhole(document.data[name], f"{name}.", "distortion_coeffs", "none")
