"""Decodes the commonest grey PNG sooner than libpng: 8 bits, every row stored as differences from pixel to pixel.

OpenCV writes such images, and so do ROS's image transport and many cameras. Two thirds of a decoder's time goes into
unpacking. Python's own zlib does it as fast as libpng's, that of the package isal (extra [fast]) in less than half the
time. Any other PNG, and every damaged one, is left to OpenCV.
"""

import struct
import zlib
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

_unpacker: Any = zlib
with suppress(ImportError):
    from isal import isal_zlib as _unpacker

_HEADER = struct.Struct(">II5B")  # width, height, bits, colours, compression, filters, interlacing
_CHUNK = struct.Struct(">I4s")  # length of the content, kind; a checksum of 4 bytes follows the content
_CHECKSUM = struct.Struct(">I")
_WITHOUT_EFFECT = (b"tEXt", b"tIME", b"pHYs")
_SUB = 1  # the filter: each byte is stored less the one on its left
_PROBED_ROWS = 8  # an encoder that chooses its filters row by row shows it in these


def decode(data: bytes) -> NDArray[np.uint8] | None:
    """The pixels (h, w) of a whole PNG of this kind, else None. Its header must be in its place."""
    packed = _packed(data)
    if packed is None:
        return None
    width, height = struct.unpack_from(">II", data, 16)
    try:
        rows = _unpacked(packed, width + 1, height)
    except _unpacker.error:
        return None
    if rows is None:
        return None
    pixels = rows[:, 1:].copy()
    reach = 1
    while reach < width:  # sums of 2, 4, 8, … neighbours: half the time of a cumulative sum
        pixels[:, reach:] += pixels[:, :-reach]
        reach *= 2
    return pixels


def _packed(data: bytes) -> bytes | None:
    """The compressed rows of an 8-bit grey image that is not interlaced and whose checksums are right, else None."""
    parts: list[bytes] = []
    at = 8
    while at + _CHUNK.size <= len(data):
        length, kind = _CHUNK.unpack_from(data, at)
        content = at + _CHUNK.size
        if content + length + _CHECKSUM.size > len(data):
            return None
        if zlib.crc32(data[at + 4 : content + length]) != _CHECKSUM.unpack_from(data, content + length)[0]:
            return None
        if kind == b"IHDR" and (
            length != _HEADER.size or _HEADER.unpack_from(data, content)[2:] != (8, 0, 0, 0, 0)
        ):
            return None
        if kind == b"IDAT":
            parts.append(data[content : content + length])
        elif kind == b"IEND":
            return b"".join(parts)
        elif kind != b"IHDR" and kind not in _WITHOUT_EFFECT:
            return None
        at = content + length + _CHECKSUM.size
    return None


def _unpacked(packed: bytes, stride: int, height: int) -> NDArray[np.uint8] | None:
    """Rows (height, stride) with the filter of each in front, None where one has another filter or is missing.

    Memory is bounded by the size that is given, whatever the bytes say.
    """
    stream = _unpacker.decompressobj()
    probed = stream.decompress(packed, min(_PROBED_ROWS, height) * stride)
    if set(probed[::stride]) != {_SUB}:
        return None
    rest = stream.decompress(stream.unconsumed_tail, height * stride - len(probed) + 1)
    if not stream.eof or len(probed) + len(rest) != height * stride:
        return None
    rows = np.frombuffer(probed + rest, np.uint8).reshape(height, stride)
    return rows if (rows[:, 0] == _SUB).all() else None
