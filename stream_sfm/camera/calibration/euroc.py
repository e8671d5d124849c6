"""EuRoC's sensor.yaml: one file per camera, with its pose in the body of the sensor unit."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...geometry import se3
from ...geometry.se3 import Array
from ..models import Camera
from .document import Document, Pair, Size

NAME = "EuRoC sensor.yaml"
FILES = 2


def matches(data: Mapping[str, Any]) -> bool:
    """Whether the content of a file describes a camera of EuRoC."""
    return "T_BS" in data and "intrinsics" in data


def pair(documents: Sequence[Document], size: Size | None) -> Pair:
    """The pair of two files, left and right."""
    left, right = documents
    return camera(left), camera(right), np.asarray(se3.inverse(body_from_cam(right)) @ body_from_cam(left))


def left(documents: Sequence[Document], size: Size | None) -> Camera:
    """The camera of the first file."""
    return camera(documents[0])


def camera(document: Document) -> Camera:
    """The camera of a file. Raises ConfigError."""
    return document.pinhole(document.data, "", "distortion_coefficients", "plumb_bob")


def body_from_cam(document: Document) -> Array:
    """The pose (4, 4) of the camera in the body: T_BS. Raises ConfigError."""
    return document.pose(document.data.get("T_BS"), "T_BS")
