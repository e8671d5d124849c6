"""Reads ROS 2 messages of numbers, texts, arrays of numbers, and parts and lists of such: those of cameras and poses.

rosbags reads all others (`ros.py`). To be imported, and to make code of two definitions, it takes a tenth of a run of a
few frames.
"""

import re
import struct
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..mcap_file.message import MAX_ROS_DEFINITION
from .message_limits import Decoder, bounded

_NUMBERS = {
    "bool": "?",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
_PART = re.compile(r"^={3,}[ \t]*\n[ \t]*MSG:[ \t]*(\S+)[ \t]*$", re.MULTILINE)  # of a type within the message
_FIELD = re.compile(r"([\w/]+)(?:\[(|[1-9]\d*)\])?[ \t]+([A-Za-z]\w*)(?:[ \t]+[-+.\w]+)?")  # with a default
_NAME = re.compile(r"\w+/msg/\w+")
_CONSTANT = re.compile(r"\w+[ \t]+\w+[ \t]*=.*")
_LITTLE_ENDIAN = b"\0\1"  # plain CDR
_HEAD, _TAIL = 4, 3  # bytes before a message, and at most after it: some writers fill up to a multiple of four
Read = Callable[[bytes, int], tuple[Any, int]]  # a value from the bytes at a place, and the place behind it


def plain_decoder(schema_name: str, definition: bytes, otherwise: Callable[[], Decoder | None]) -> Decoder | None:
    """A function from the bytes of one message in CDR to an object with its fields; None for other definitions.

    `otherwise`: makes the decoder of messages in another byte order. The function raises ValueError, or what `struct`
    raises, on bytes that do not fit.
    """
    if len(definition) > MAX_ROS_DEFINITION or _NAME.fullmatch(schema_name) is None:
        return None
    own, *parts = _PART.split(definition.decode("utf-8", "replace").replace("\r\n", "\n"))
    name = _short(schema_name)
    types = _Types({name: own} | {_short(part): text for part, text in zip(parts[::2], parts[1::2], strict=True)})
    read = types.message(name)
    if read is None:
        return None

    def decode(data: bytes) -> Any:
        if data[:2] != _LITTLE_ENDIAN:
            other = otherwise()
            if other is None:
                raise ValueError("messages in this byte order cannot be read")
            return other(data)
        message, end = read(data, _HEAD)
        if not len(data) - _TAIL <= end <= len(data):
            raise ValueError(f"{end} bytes are expected")
        return message

    return bounded(decode) if types.repeat else decode


def _short(name: str) -> str:
    """Package/Name of package/msg/Name."""
    return name.replace("/msg/", "/")


class _Types:
    """What reads the types of a definition, `texts` by name; `repeat`: whether one is a list of messages."""

    def __init__(self, texts: dict[str, str]) -> None:
        self._texts, self._known = texts, dict[str, Read | None]()
        self.repeat = False

    def message(self, name: str) -> Read | None:
        """Return what reads messages of a type, of one byte at least; None where one of its fields is not plain."""
        if name in self._known or name not in self._texts:
            return self._known.get(name)
        self._known[name] = None  # a type within itself
        fields: dict[str, Read] = {}
        for line in self._texts[name].splitlines():
            bare = line.partition("#")[0].strip()
            if not bare or _CONSTANT.fullmatch(bare):
                continue
            field = _FIELD.fullmatch(bare)
            read = None if field is None else self._value(field[1], field[2], name)
            if field is None or read is None or field[3] in fields:
                return None
            fields[field[3]] = read
        if not fields:
            return None

        def read_all(data: bytes, at: int) -> tuple[Any, int]:
            values = {}
            for key, read_one in fields.items():
                values[key], at = read_one(data, at)
            return SimpleNamespace(**values), at

        self._known[name] = read_all
        return read_all

    def _value(self, kind: str, length: str | None, within: str) -> Read | None:
        """Return what reads a field of a type; `length`: of an array, empty where each message says it."""
        if kind in _NUMBERS:
            return _number(_NUMBERS[kind]) if length is None else _array(_NUMBERS[kind], length)
        if kind == "string":
            return _text if length is None else None
        read = self.message(kind if "/" in kind else f"{within.partition('/')[0]}/{kind}")
        if length is None or read is None:
            return read
        self.repeat = True
        return None if length else _list(read)


def _number(code: str) -> Read:
    packed = struct.Struct("<" + code)

    def read(data: bytes, at: int) -> tuple[Any, int]:
        at = _aligned(at, packed.size)
        return packed.unpack_from(data, at)[0], at + packed.size

    return read


_count = _number("I")


def _text(data: bytes, at: int) -> tuple[str, int]:
    length, at = _count(data, at)
    if at + length > len(data):
        raise ValueError(f"a text of {length} bytes")
    return data[at : at + max(length - 1, 0)].decode(), at + length


def _array(code: str, length: str) -> Read:
    dtype = np.dtype("<" + code)

    def read(data: bytes, at: int) -> tuple[Any, int]:
        count, at = (int(length), at) if length else _count(data, at)
        if not count:
            return np.empty(0, dtype), at
        at = _aligned(at, dtype.itemsize)
        return np.frombuffer(data, dtype, count, at), at + count * dtype.itemsize

    return read


def _list(read_one: Read) -> Read:
    def read(data: bytes, at: int) -> tuple[Any, int]:
        count, at = _count(data, at)
        values = []
        for _ in range(count):  # the bytes end before a wrong count does
            value, at = read_one(data, at)
            values.append(value)
        return values, at

    return read


def _aligned(at: int, size: int) -> int:
    """The next place that is a multiple of a size from the message's beginning."""
    return at + (_HEAD - at) % size
