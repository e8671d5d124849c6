"""Depth images in metres: 16-bit PNG in units of 0.1 mm, and ROS's own (REP 118), raw or as `compressedDepth`."""

import struct
from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from .images import UndecodableImage, decode_grey, raw_rows
from .messages import ImageMessage

_PNG_UNIT_M = 1e-4  # of a plain 16-bit PNG: the log profile's
_ROS_UNIT_M = 1e-3  # of 16UC1 images: REP 118
# compressed_depth_image_transport puts these before the PNG: format, and the two parameters of inverse depth
_COMPRESSED_DEPTH = struct.Struct("<iff")


def decode_depth_m(message: ImageMessage) -> NDArray[np.float32]:
    """Depth (h, w) in metres, NaN where unknown. Raises UndecodableImage for other images and damaged bytes."""
    kind = message.encoding.lower()
    if message.compressed:
        return _compressed_depth_m(message) if "compresseddepth" in kind else _scaled(message, _PNG_UNIT_M)
    if kind != "32fc1":
        return _scaled(message, _ROS_UNIT_M)
    rows = np.ascontiguousarray(raw_rows(message, 4))
    depth_m = rows.view(">f4" if message.big_endian else "<f4").astype(np.float32)
    return np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, np.float32(np.nan))


def _compressed_depth_m(message: ImageMessage) -> NDArray[np.float32]:
    """Millimetres, or inverse depth where the camera gave 32FC1: near points keep their precision that way."""
    if len(message.data) < _COMPRESSED_DEPTH.size:
        raise UndecodableImage(f"{message.topic}: a compressed depth image of {len(message.data)} bytes")
    _, scale, shift = _COMPRESSED_DEPTH.unpack_from(message.data)
    message = replace(message, data=message.data[_COMPRESSED_DEPTH.size :])
    if not message.encoding.lower().startswith("32fc1"):
        return _scaled(message, _ROS_UNIT_M)
    raw = _uint16(message)
    with np.errstate(divide="ignore"):
        return np.where(raw > 0, np.float32(scale) / (raw - np.float32(shift)), np.float32(np.nan))


def _scaled(message: ImageMessage, unit_m: float) -> NDArray[np.float32]:
    raw = _uint16(message)
    return np.where(raw > 0, raw * np.float32(unit_m), np.float32(np.nan))


def _uint16(message: ImageMessage) -> NDArray[np.uint16]:
    raw = decode_grey(message)
    if raw.dtype != np.uint16:
        raise UndecodableImage(f"{message.topic}: depth must have 16 bits, or 32 as 32FC1")
    return cast(NDArray[np.uint16], raw)
