"""Decodes plain grey PNG images, the usual ones of a stereo log, in half the time of OpenCV; the same pixels."""

import struct

import numpy as np

from .. import core
from ..camera.pixels import Grey
from ..deflate import zlib
from ..sources.image_header import PNG_CHUNK, PNG_SIGNATURE

_HEADER = struct.Struct(">8sI4sIIBBBBBI")  # up to the checksum of the first chunk
_WITHOUT_PIXELS = (b"IHDR", b"pHYs", b"tEXt", b"tIME")  # chunks that no decoder obeys


def decode_plain_png(data: bytes) -> Grey | None:
    """Grey (h, w) of 8 or 16 bits of a PNG without interlacing, transparency or palette; None for all others.

    None, too, where anything is damaged: another decoder may save or refuse it. `image_header.problem` must have
    passed, and the size be one that memory has room for.
    """
    if len(data) < _HEADER.size:
        return None
    signature, length, _, width, height, bits, *kind, _ = _HEADER.unpack_from(data)
    # grey; compressed, filtered and ordered by the one way that the specification names first
    usual = not any(kind)
    if signature != PNG_SIGNATURE or length != 13 or bits not in (8, 16) or not usual:
        return None
    pixel = bits // 8
    size, content = height * (1 + width * pixel), _content(data)
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


def _content(whole: bytes) -> bytes | memoryview | None:
    """The compressed pixels; None where a checksum is wrong, or a chunk is there that says how to take them."""
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
