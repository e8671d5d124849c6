"""Format and size of an image by its first bytes, without decoding."""

import re
import struct
from typing import NamedTuple

from ...system.inputs import LIMITS


class ImageFormat(NamedTuple):
    """A format of images: its name, its first bytes, and its suffixes; logs may hold those `in_logs`."""

    name: str
    start: bytes  # a regular expression
    suffixes: tuple[str, ...]
    in_logs: bool = True


FORMATS = (
    ImageFormat("PNG", rb"\x89PNG\r\n\x1a\n", (".png",)),
    ImageFormat("JPEG", rb"\xff\xd8\xff", (".jpg", ".jpeg")),
    ImageFormat("WebP", rb"(?s)RIFF.{4}WEBP", (".webp",)),
    ImageFormat("BMP", rb"BM", (".bmp",), in_logs=False),
    ImageFormat("TIFF", rb"II\*\0|MM\0\*", (".tif", ".tiff"), in_logs=False),
    ImageFormat("PNM", rb"P[56]\s", (".pgm", ".ppm", ".pnm"), in_logs=False),
)
IMAGE_SUFFIXES = tuple(suffix for of in FORMATS for suffix in of.suffixes)
COMPRESSED_FORMATS = tuple(of.name.lower() for of in FORMATS if of.in_logs)  # of one image by itself
_STARTS = {of.name.lower(): re.compile(of.start) for of in FORMATS if of.in_logs}
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PNG_CHUNK = struct.Struct(">I4s")  # length of the content, kind; a checksum of 4 bytes follows the content
_TIFF = ((b"II*\0", "<"), (b"MM\0*", ">"))  # with the order of bytes
_TIFF_SIZE = {256: "width", 257: "height"}  # tags
_PNM_SIZE = re.compile(rb"P[56]\s+(?:#[^\n]*\n\s*)*(\d{1,9})\s+(?:#[^\n]*\n\s*)*(\d{1,9})\s")
_PNM_HEADER = 1000  # bytes, with comments


def plain_size(data: bytes) -> tuple[int, int] | None:
    """Return width and height in pixels of a BMP, TIFF or PNM image; None for anything else or a damaged header."""
    try:
        if (pnm := _PNM_SIZE.match(data[:_PNM_HEADER])) is not None:
            return int(pnm[1]), int(pnm[2])
        if data.startswith(b"BM"):
            width, height = struct.unpack_from("<ii", data, 18)
            return width, abs(height)  # negative: from the top down
        order = next((order for magic, order in _TIFF if data.startswith(magic)), None)
        if order is None:
            return None
        (at,) = struct.unpack_from(f"{order}I", data, 4)
        (count,) = struct.unpack_from(f"{order}H", data, at)
        found = {}
        for n in range(count):
            tag, kind = struct.unpack_from(f"{order}HH", data, at + 2 + 12 * n)
            if tag in _TIFF_SIZE:  # a number of 16 or 32 bits
                found[tag] = struct.unpack_from(f"{order}{'H' if kind == 3 else 'I'}", data, at + 10 + 12 * n)[0]
        return found[256], found[257]
    except (struct.error, KeyError):
        return None


def image_format(data: bytes) -> str | None:
    """Return png, jpeg or webp by the first bytes of a compressed image; None for anything else."""
    return next((name for name, start in _STARTS.items() if start.match(data)), None)


def image_size(data: bytes) -> tuple[int, int] | None:
    """Return width and height in pixels of a compressed image; None if its header is damaged or of another format."""
    try:
        if data.startswith(b"\x89PNG"):
            width, height = struct.unpack_from(">II", data, 16)
            return width, height
        if data.startswith(b"\xff\xd8"):
            return _jpeg_size(data)
        if data.startswith(b"RIFF") and data[8:12] == b"WEBP":
            return _webp_size(data)
    except (struct.error, IndexError):
        pass
    return None


def problem(data: bytes) -> str:
    """Say why a compressed image must not be handed to a decoder; empty if it may.

    Decoders reserve the memory that a chunk of a PNG declares before they check that the data is there, and process
    a JPEG once per scan.
    """
    if data.startswith(b"\xff\xd8"):
        scans = data.count(b"\xff\xda")
        return f"it has {scans} scans" if scans > LIMITS.jpeg_scans else ""
    if not data.startswith(b"\x89PNG"):
        return ""
    at = len(PNG_SIGNATURE)
    while at < len(data):
        if len(data) - at < PNG_CHUNK.size:
            return "its last chunk is cut off"
        length, kind = PNG_CHUNK.unpack_from(data, at)
        if (at == len(PNG_SIGNATURE)) != (kind == b"IHDR"):
            return "its header is not in its place"
        if length > len(data) - at - PNG_CHUNK.size:
            return f"a chunk of {length} bytes where {len(data) - at - PNG_CHUNK.size} are left"
        if kind == b"acTL":
            return "it is an animation"
        if kind == b"IEND":
            return ""
        at += PNG_CHUNK.size + length + 4
    return ""


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Read the size from the frame header; the segments before it (marker, length, content) are skipped."""
    at = 2
    while data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xFF:  # padding
            at += 1
            continue
        if marker == 0x01 or 0xD0 <= marker <= 0xD7:  # no length follows; decoders continue right behind
            at += 2
            continue
        if marker == 0x00:
            break
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", data, at + 5)
            return width, height
        at += 2 + struct.unpack_from(">H", data, at + 2)[0]
    return None


def _webp_size(data: bytes) -> tuple[int, int] | None:
    """Read the size from the first chunk: lossy, lossless or extended."""
    if data[12:16] == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    if data[12:16] == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if data[12:16] == b"VP8X":
        return int.from_bytes(data[24:27], "little") + 1, int.from_bytes(data[27:30], "little") + 1
    return None
