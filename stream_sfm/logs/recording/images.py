"""Decodes images of every recorded encoding to grey (h, w): uint8, or uint16 if the camera gave more bits.

Depth images become metres: 16-bit PNG in units of 0.1 mm, and ROS's depth images (REP 118), raw or `compressedDepth`.
"""

import re
import struct
from dataclasses import replace
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from ... import core
from ...camera.models import MAX_PIXELS
from ...camera.pixels import Grey
from ...errors import LogError
from ...system import memory
from ...system.deflate import zlib
from ...system.inputs import LIMITS
from ..sources import image_header
from ..sources.image_header import COMPRESSED_FORMATS, PNG_CHUNK, PNG_SIGNATURE
from .messages import ImageMessage, UndecodableMessage

# colours of a pixel -> (channels, OpenCV's conversions to grey and to red, green, blue; None if not needed)
_COLOURS: dict[str, tuple[int, int | None, int | None]] = {
    "rgb": (3, cv2.COLOR_RGB2GRAY, None), "bgr": (3, cv2.COLOR_BGR2GRAY, cv2.COLOR_BGR2RGB),
    "rgba": (4, cv2.COLOR_RGBA2GRAY, cv2.COLOR_RGBA2RGB), "bgra": (4, cv2.COLOR_BGRA2GRAY, cv2.COLOR_BGRA2RGB),
    "bayer_rggb": (1, cv2.COLOR_BayerRGGB2GRAY, cv2.COLOR_BayerRGGB2RGB),
    "bayer_bggr": (1, cv2.COLOR_BayerBGGR2GRAY, cv2.COLOR_BayerBGGR2RGB),
    "bayer_gbrg": (1, cv2.COLOR_BayerGBRG2GRAY, cv2.COLOR_BayerGBRG2RGB),
    "bayer_grbg": (1, cv2.COLOR_BayerGRBG2GRAY, cv2.COLOR_BayerGRBG2RGB),
}  # fmt: skip
_GREY = (1, None, None)
# encoding -> (bits per channel, and the same)
_PLAIN = {f"{name}{bits}": (bits, *colours) for name, colours in _COLOURS.items() for bits in (8, 16)}
_PLAIN |= {"mono8": (8, *_GREY), "8uc1": (8, *_GREY), "mono16": (16, *_GREY), "16uc1": (16, *_GREY)}
_PLAIN |= {"8uc3": (8, *_COLOURS["bgr"]), "8uc4": (8, *_COLOURS["bgra"])}
# which of the two bytes of a pixel is the luma
_LUMA_BYTE = {"yuv422": 1, "uyvy": 1, "yuv422_uyvy": 1, "yuyv": 0, "yuv422_yuy2": 0, "yuy2": 0}
_LUMA_PLANE = ("nv12", "nv21", "nv24", "i420", "yuv420")  # luma first, one byte per pixel

_COMPRESSED = re.compile("|".join(("jpg", *COMPRESSED_FORMATS)))
RAW_ENCODINGS = (*_PLAIN, *_LUMA_BYTE, *_LUMA_PLANE)
_PNG_UNIT_M = 1e-4  # of a plain 16-bit PNG: the log profile's
_ROS_UNIT_M = 1e-3  # of 16UC1 images: REP 118
# compressed_depth_image_transport puts these before the PNG: format, and the two parameters of inverse depth
_COMPRESSED_DEPTH = struct.Struct("<iff")
_PNG_HEADER = struct.Struct(">8sI4sIIBBBBBI")  # up to the checksum of the first chunk
_WITHOUT_PIXELS = (b"IHDR", b"pHYs", b"tEXt", b"tIME")  # chunks that do not affect decoding


class UndecodableImage(UndecodableMessage):
    """The bytes of this image are damaged; the next one may be intact."""


def image_size(message: ImageMessage) -> tuple[int, int] | None:
    """Return width and height, pixels, without decoding; None if the header of a compressed image is damaged."""
    if not message.compressed:
        return message.width, message.height
    return image_header.image_size(message.data)


def check_encoding(message: ImageMessage, path: object) -> None:
    """Raise LogError if images of this encoding are not supported at all, whatever their bytes."""
    where = f"{path}: topic {message.topic}"
    if not message.compressed:
        name = message.encoding.lower()
        if len(message.data) > LIMITS.raw_image_bytes:
            raise LogError(
                f"{where}: raw images of {len(message.data) / 2**20:.0f} MiB are not read, only those of up to "
                f"{LIMITS.raw_image_bytes // 2**20} MiB: record them in grey, compressed, or smaller"
            )
        if name not in RAW_ENCODINGS:
            known = f"{', '.join(RAW_ENCODINGS)}: record one of these"
            raise LogError(f"{where}: image encoding {message.encoding!r} is not supported; supported are {known}")
    elif image_header.image_format(message.data) is None and not _COMPRESSED.search(message.encoding.lower()):
        known = f"{', '.join(COMPRESSED_FORMATS)}, H.264 and H.265: record one of these, or raw images"
        raise LogError(f"{where}: compressed images in format {message.encoding!r} are not supported, only {known}")
    if "compresseddepth" in message.encoding.lower().replace(" ", ""):
        raise LogError(f"{where} holds depth images: name the topics of the two cameras", hint=("left", "right"))


def decode_grey(message: ImageMessage) -> Grey:
    """Decode one image to grey (h, w): uint8, or unscaled uint16 if more bits were recorded.

    `check_encoding` must have passed. Raises UndecodableImage for damaged bytes.
    """
    try:
        if message.compressed:
            return _decode_compressed(message)
        pixels, to_grey, _ = _raw_pixels(message)
        return pixels if to_grey is None else cv2.cvtColor(pixels, to_grey)
    except cv2.error as error:
        if memory.is_refused(error):
            raise
        raise UndecodableImage(f"{message.topic}: {error.err}") from None


def _decode_compressed(message: ImageMessage) -> Grey:
    width, height = image_size(message) or (0, 0)
    if not 0 < width * height <= MAX_PIXELS:  # before a few bytes become gigabytes
        raise UndecodableImage(f"{message.topic}: {len(message.data)} bytes that declare {width}×{height} pixels")
    if problem := image_header.problem(message.data):
        raise UndecodableImage(f"{message.topic}: an image that is not decoded: {problem}")
    if (grey := decode_plain_png(message.data)) is not None:
        return grey
    # An orientation tag is ignored, because the calibration refers to the pixels as recorded.
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    image = cv2.imdecode(np.frombuffer(message.data, np.uint8), flags)
    if image is None or image.dtype not in (np.uint8, np.uint16):
        kind = message.encoding or "compressed"
        raise UndecodableImage(f"{message.topic}: {len(message.data)} bytes are not a {kind} image")
    return cast(Grey, image)


def decode_plain_png(data: bytes) -> Grey | None:
    """Decode a PNG without interlacing, transparency or palette to grey (h, w), 8 or 16 bits; None for all others.

    Damaged ones also give None: another decoder may rescue or refuse them. `image_header.problem` must have
    passed, and the size must fit into memory.
    """
    if len(data) < _PNG_HEADER.size:
        return None
    signature, length, _, width, height, bits, *kind, _ = _PNG_HEADER.unpack_from(data)
    # grey, with compression, filter and order of type 0
    usual = not any(kind)
    if signature != PNG_SIGNATURE or length != 13 or bits not in (8, 16) or not usual:
        return None
    pixel = bits // 8
    size, content = height * (1 + width * pixel), _png_content(data)
    if content is None:
        return None
    stream = zlib.decompressobj()
    try:
        filtered = stream.decompress(content, size + 1)
        if len(filtered) != size or not stream.eof:
            return None
        rows = core.unfilter_png(np.frombuffer(filtered, np.uint8).reshape(height, -1), pixel)
    except (zlib.error, ValueError):
        return None
    return rows if pixel == 1 else rows.view(">u2").astype(np.uint16)


def _png_content(whole: bytes) -> bytes | memoryview | None:
    """Return the compressed pixels; None if a checksum is wrong, or a chunk changes how to interpret them."""
    data, at = memoryview(whole), len(PNG_SIGNATURE)
    parts: list[memoryview] = []
    while at + PNG_CHUNK.size < len(data):
        length, kind = PNG_CHUNK.unpack_from(data, at)
        end = at + PNG_CHUNK.size + length
        if data[end : end + 4] != zlib.crc32(data[at + 4 : end]).to_bytes(4, "big"):
            return None
        if kind == b"IEND":
            return parts[0] if len(parts) == 1 else b"".join(parts)
        if kind == b"IDAT":
            parts.append(data[at + PNG_CHUNK.size : end])
        elif kind not in _WITHOUT_PIXELS:
            return None
        at = end + 4
    return None


def decode_rgb(message: ImageMessage) -> NDArray[np.uint8] | None:
    """Decode an 8-bit image to red, green, blue (h, w, 3); None if it is grey, deeper, or luma only.

    `decode_grey` must have accepted the message. Raises the same errors.
    """
    if message.compressed:
        flags = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
        pixels = cv2.imdecode(np.frombuffer(message.data, np.uint8), flags)
        conversion: int | None = cv2.COLOR_BGR2RGB
        if pixels is None or pixels.ndim == 2:
            return None
    else:
        pixels, to_grey, conversion = _raw_pixels(message)
        if to_grey is None:
            return None
    if pixels.dtype != np.uint8:
        return None
    return np.asarray(pixels if conversion is None else cv2.cvtColor(pixels, conversion), np.uint8)


def _raw_pixels(message: ImageMessage) -> tuple[Any, int | None, int | None]:
    """Return pixels (h, w) or (h, w, channels), and OpenCV's conversions as in `_COLOURS`."""
    name = message.encoding.lower()
    if len(message.data) > LIMITS.raw_image_bytes:
        raise UndecodableImage(f"{message.topic}: a raw image of {len(message.data) / 2**20:.0f} MiB")
    if name not in RAW_ENCODINGS:
        raise UndecodableImage(f"{message.topic}: image encoding {message.encoding!r} is not supported")
    bits, channels, to_grey, to_rgb = _PLAIN.get(name, (8, 2 if name in _LUMA_BYTE else 1, None, None))
    rows = raw_rows(message, channels * bits // 8)
    if name in _LUMA_BYTE:
        return np.ascontiguousarray(rows[:, _LUMA_BYTE[name] :: 2]), None, None
    pixels: Any = np.ascontiguousarray(rows)
    if bits == 16:
        pixels = pixels.view(">u2" if message.big_endian else "<u2").astype(np.uint16)
    if channels > 1:
        pixels = pixels.reshape(message.height, message.width, channels)
    return pixels, to_grey, to_rgb


def raw_rows(message: ImageMessage, pixel_bytes: int) -> NDArray[np.uint8]:
    """Return the bytes of a raw image, (h, w · pixel_bytes) uint8, without row padding. Raises UndecodableImage."""
    width, height = message.width, message.height
    row = width * pixel_bytes
    step = message.step or row
    if width <= 0 or height <= 0 or step < row or len(message.data) < step * (height - 1) + row:
        size = f"{width}×{height} {message.encoding} with {step} bytes per row"
        raise UndecodableImage(f"{message.topic}: {len(message.data)} bytes do not hold {size}")
    data = np.frombuffer(message.data, np.uint8)
    return np.lib.stride_tricks.as_strided(data, (height, row), (step, 1), writeable=False)


def decode_depth_m(message: ImageMessage) -> NDArray[np.float32]:
    """Decode depth (h, w) in metres, NaN where unknown. Raises UndecodableImage for other images and damaged bytes."""
    kind = message.encoding.lower()
    if message.compressed:
        return _compressed_depth_m(message) if "compresseddepth" in kind else _scaled(message, _PNG_UNIT_M)
    if kind != "32fc1":
        return _scaled(message, _ROS_UNIT_M)
    rows = np.ascontiguousarray(raw_rows(message, 4))
    depth_m = rows.view(">f4" if message.big_endian else "<f4").astype(np.float32)
    return np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, np.float32(np.nan))


def _compressed_depth_m(message: ImageMessage) -> NDArray[np.float32]:
    """Decode millimetres, or inverse depth if the camera gave 32FC1, which keeps the precision of near points."""
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
