"""MCAP records: one byte for the kind, eight for the length, then the body.

Only the bodies are handed to the `mcap` library, because its readers trust the lengths that a damaged file gives and
let five kinds of exception escape.
"""

import io
import os
import struct
from collections.abc import Callable, Iterator
from typing import IO, Any

from mcap.data_stream import ReadDataStream

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = struct.Struct("<BQ")  # opcode, length of the body in bytes
# Of a chunk: first and last log time, uncompressed size in bytes, CRC-32, length of the compression's name.
CHUNK_HEAD = struct.Struct("<QQQII")


class BrokenRecord(Exception):
    """A record cannot be parsed; the message says why."""


class RecordTooLarge(BrokenRecord):
    """A record is sound but exceeds the memory granted to its kind."""


def parse_record(reader: Callable[..., Any], body: bytes | memoryview) -> Any:
    """Parse the body of one record with a reader of the mcap library; any failure becomes `BrokenRecord`."""
    try:
        return reader(ReadDataStream(io.BytesIO(body)))
    except Exception as error:  # struct.error, EndOfFile, UnicodeDecodeError, KeyError: the body is damaged
        raise BrokenRecord(f"{type(error).__name__} {error}".strip()) from None


def split_records(data: memoryview, count: Callable[[], None] = lambda: None) -> Iterator[tuple[int, memoryview]]:
    """Yield (opcode, body) of the records that follow each other in `data`; `count` is called before each.

    Raises BrokenRecord where their lengths do not add up.
    """
    position = 0
    while position < len(data):
        if position + RECORD_HEAD.size > len(data):
            raise BrokenRecord("its last record is cut off")
        opcode, length = RECORD_HEAD.unpack_from(data, position)
        position += RECORD_HEAD.size
        if length > len(data) - position:
            raise BrokenRecord(f"it has a record of {length} bytes where {len(data) - position} are left")
        count()
        yield opcode, data[position : position + length]
        position += length


def ends_with_magic(stream: IO[bytes]) -> bool:
    """Whether the last bytes are those of an MCAP file, so that it may be one whose first ones are damaged."""
    size = stream.seek(0, os.SEEK_END)
    stream.seek(max(size - len(MAGIC), 0))
    return size >= 2 * len(MAGIC) and stream.read(len(MAGIC)) == MAGIC
