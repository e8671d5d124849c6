"""The content of MCAP chunks, whole or cut off, never inflated beyond what they declare and what is sane."""

import struct
import zlib
from typing import Any

import lz4.frame
import zstandard

from .records import MAX_RECORD_BYTES, BrokenRecord

_CHUNK = struct.Struct("<QQQI")
_STEP = 1 << 17


def inflate(body: bytes, whole: bool) -> bytes | memoryview:
    """The records in a chunk's body; of a body that is cut off (not `whole`), those bytes that can be had.

    Raises BrokenRecord for lengths that do not fit, a wrong checksum, or an unknown compression.
    """
    if len(body) < _CHUNK.size + 4:
        raise BrokenRecord("its header is cut off")
    _, _, size, crc = _CHUNK.unpack_from(body)
    if size > MAX_RECORD_BYTES:
        raise BrokenRecord(f"it claims to inflate to {size / 2**20:.0f} MiB, over {MAX_RECORD_BYTES / 2**20:.0f}")
    (name_length,) = struct.unpack_from("<I", body, _CHUNK.size)
    start = _CHUNK.size + 4 + name_length + 8
    if start > len(body):
        raise BrokenRecord("its header is cut off")
    compression = bytes(body[_CHUNK.size + 4 : start - 8])
    (data_length,) = struct.unpack_from("<Q", body, start - 8)
    data = memoryview(body)[start:]
    if whole and data_length > len(data):
        raise BrokenRecord("its lengths do not add up")
    data = data[:data_length]
    inflated: bytes | memoryview
    try:
        if compression == b"zstd":
            inflated = _unzstd(data, size, whole)
        elif compression == b"lz4":
            inflated = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size)
        elif compression == b"":
            inflated = data
        else:
            raise BrokenRecord(f"compression {compression!r} is not known; zstd, lz4 and none are")
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise BrokenRecord(f"it cannot be inflated: {error}") from None
    if whole and len(inflated) != size:
        raise BrokenRecord(f"it inflates to {len(inflated)} bytes and claims {size}")
    if crc and len(inflated) == size and zlib.crc32(inflated) != crc:
        raise BrokenRecord("its checksum does not fit its content")
    return inflated


def _unzstd(data: memoryview, size: int, whole: bool) -> bytes:
    """Up to `size` bytes; of a cut-off stream what comes before the cut."""
    with zstandard.ZstdDecompressor().stream_reader(data) as reader:
        if whole:
            return reader.read(size) if size else b""
        parts: list[Any] = []
        try:
            while size > 0 and (part := reader.read(min(size, _STEP))):
                parts.append(part)
                size -= len(part)
        except zstandard.ZstdError:
            pass  # the cut
        return b"".join(parts)
