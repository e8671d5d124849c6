"""Decompression of chunks of MCAP and ROS 1 bags, intact or cut off, within the size that they declare."""

import bz2
from contextlib import suppress
from typing import Any

import lz4.frame
import zstandard

from ...system.deflate import zlib
from ...system.inputs import LIMITS
from .records import CHUNK_HEAD, BrokenRecord

# Limits on unpacked records and bytes per stored byte, above those of real chunks: a record in a log of a camera
# has thousands of bytes, and black images compress best. All chunks of a reading may exceed them by some seconds of
# work.
_RECORDS_PER_BYTE, _FREE_RECORDS = 1, 2**20
_BYTES_PER_BYTE, _FREE_BYTES = 1000, 2**34


class Allowance:
    """How many records and bytes the chunks of one reading may unpack to. Raises BrokenRecord beyond that."""

    def __init__(self, free_bytes: int | None = None) -> None:
        self._records_left = 0  # that the current chunk may still hold
        self._free_records = _FREE_RECORDS  # for all chunks, beyond the usual number
        self._free_bytes = _FREE_BYTES if free_bytes is None else free_bytes

    def begin(self, stored_bytes: int, declared_bytes: int) -> None:
        """Begin a chunk with its stored size and its declared unpacked size, bytes."""
        self._records_left = _RECORDS_PER_BYTE * stored_bytes
        if declared_bytes > LIMITS.record_bytes:  # it will not be unpacked
            return
        excess = max(declared_bytes - _BYTES_PER_BYTE * stored_bytes, 0)
        if excess > self._free_bytes:
            raise BrokenRecord(
                f"{stored_bytes} bytes declare over {_BYTES_PER_BYTE} times as many, and not for the first time"
            )
        self._free_bytes -= excess

    def take_record(self) -> None:
        self._records_left -= 1
        if self._records_left < 0:
            self._free_records -= 1
            if self._free_records < 0:
                raise BrokenRecord("it holds more records than bytes, as none does that a camera has filled")


def decompress_chunk(body: bytes, whole: bool, allowance: Allowance, verify: bool = True) -> bytes | memoryview:
    """Return the records in the body of a chunk; if it is cut off (not `whole`), the bytes before the cut.

    `verify`: compare the checksum, if there is one and nothing is missing. Raises BrokenRecord.
    """
    if len(body) < CHUNK_HEAD.size:
        raise BrokenRecord("its header is cut off")
    _, _, size, crc, name_length = CHUNK_HEAD.unpack_from(body)
    start = CHUNK_HEAD.size + name_length + 8
    if start > len(body):
        raise BrokenRecord("its header is cut off")
    length, data = int.from_bytes(body[start - 8 : start], "little"), memoryview(body)[start:]
    if whole and length > len(data):
        raise BrokenRecord("its lengths do not add up")
    allowance.begin(len(body), size)
    records = decompress(body[CHUNK_HEAD.size : start - 8], data[:length], size, whole)
    if verify and crc and len(records) == size and zlib.crc32(records) != crc:
        raise BrokenRecord("its checksum does not match its content")
    return records


def decompress(compression: bytes, data: bytes | memoryview, size: int, whole: bool) -> bytes | memoryview:
    """Decompress a chunk of MCAP or a ROS 1 bag, with a declared `size` and a named compression.

    Raises BrokenRecord; if the chunk is not `whole`, fewer bytes are not an error.
    """
    if size > LIMITS.record_bytes:
        raise BrokenRecord(f"it declares {size / 2**20:.0f} MiB, over {LIMITS.record_bytes / 2**20:.0f} MiB")
    records: bytes | memoryview
    try:
        if compression == b"zstd":
            records = _decompress_zstd(data, size, whole)
        elif compression == b"lz4":
            records = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size)
        elif compression == b"bz2":
            records = bz2.BZ2Decompressor().decompress(data, max_length=size)
        elif compression in (b"", b"none"):
            records = data
        else:
            raise BrokenRecord(f"compression {compression!r} is not supported, only zstd, lz4, bz2 and none")
    except (zstandard.ZstdError, RuntimeError, EOFError, OSError, ValueError, MemoryError) as error:
        raise BrokenRecord(f"it cannot be decompressed: {error}") from None
    if whole and len(records) != size:
        raise BrokenRecord(f"it decompresses to {len(records)} bytes but declares {size}")
    return records


def _decompress_zstd(data: bytes | memoryview, size: int, whole: bool) -> bytes:
    with zstandard.ZstdDecompressor().stream_reader(data) as reader:
        if whole:
            return reader.read(size) if size else b""
        parts: list[Any] = []
        with suppress(zstandard.ZstdError):  # in small steps, so that everything before the cut is kept
            while size > 0 and (part := reader.read(min(size, 2**14))):
                parts.append(part)
                size -= len(part)
        return b"".join(parts)
