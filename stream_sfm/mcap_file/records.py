"""MCAP records as they stand in a file or a chunk: one byte for the kind, eight for the length, the body.

The framing is read here and only the bodies are handed to the `mcap` library, because its readers believe the
lengths that a damaged file claims and let five kinds of exception escape.
"""

import io
import struct
from collections.abc import Callable, Iterator
from typing import Any

from mcap.data_stream import ReadDataStream

MAGIC = b"\x89MCAP0\r\n"
MAX_RECORD_BYTES = 128 * 2**20  # a record or an inflated chunk beyond this is damage, or hostile
FRAME = struct.Struct("<BQ")


class BrokenRecord(Exception):
    """The record cannot be parsed; the message says why."""


def parse(reader: Callable[..., Any], body: bytes | memoryview) -> Any:
    """One record by the mcap library, any failure as `BrokenRecord`."""
    try:
        return reader(ReadDataStream(io.BytesIO(body)))
    except Exception as error:  # struct.error, EndOfFile, UnicodeDecodeError, KeyError: the body is damaged
        raise BrokenRecord(f"{type(error).__name__} {error}".strip()) from None


def split(body: memoryview) -> Iterator[tuple[int, memoryview]]:
    """(opcode, body) of the records that stand one after the other in `body`.

    Raises BrokenRecord where they do not add up.
    """
    position = 0
    while position < len(body):
        if position + FRAME.size > len(body):
            raise BrokenRecord("the last record is cut off")
        opcode, length = FRAME.unpack_from(body, position)
        position += FRAME.size
        if length > len(body) - position:
            raise BrokenRecord(f"a record of {length} bytes where {len(body) - position} are left")
        yield opcode, body[position : position + length]
        position += length
