"""Types of ROS 2 messages by their definitions, and the bytes of messages in CDR, little-endian.

rosbags encodes every type there is, and takes 40 ms at each start for the two dozen that are written here.
"""

import re
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property, partial
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

_NUMBERS = "bool byte char int8 uint8 int16 uint16 int32 uint32 int64 uint64 float32 float64"
_FORMATS = dict(zip(_NUMBERS.split(), "?BBbBhHiIqQfd", strict=True))
_FIELD = re.compile(r"^([\w/]+)(\[\d*\])? (\w+)$", re.MULTILINE)  # constants have a value, comments begin with #
_HEADER = b"\0\1\0\0"  # little-endian, no parameters; positions count from behind it
_PART = "=" * 80 + "\nMSG: "  # before the definition of each part

Put = Callable[[bytearray, Any], None]


class MessageTypes(dict[str, "MessageType"]):
    """Types by name (package/msg/Name) from their definitions, a field in each line."""

    def __init__(self, definitions: Mapping[str, str]) -> None:
        super().__init__((name, MessageType(text, self)) for name, text in definitions.items())

    def of_part(self, base: str) -> "MessageType | None":
        """Return the type that definitions call package/Name; None of numbers and text."""
        return self.get(base.replace("/", "/msg/"))


class MessageType:
    """One type, with its definition as `text`; `arrays`: its fields that are arrays of numbers, and of which."""

    def __init__(self, text: str, types: MessageTypes) -> None:
        self.text, self._types = text, types
        self._fields: list[tuple[str, str, str]] = _FIELD.findall(text)
        self.arrays = {
            field: "<" + _FORMATS[base] for base, many, field in self._fields if many and base in _FORMATS
        }

    @property
    def whole_text(self) -> str:
        """The definition with those of all parts, as recordings have it."""
        parts = dict(self._parts())
        return "".join([self.text, *(f"{_PART}{name}\n{part.text}" for name, part in parts.items())])

    def _parts(self) -> Iterator[tuple[str, "MessageType"]]:
        for base, *_ in self._fields:
            if part := self._types.of_part(base):
                yield base, part
                yield from part._parts()

    def encoded(self, message: Any) -> bytes:
        """Return the bytes of a message, whose fields and parts are attributes."""
        out = bytearray()
        self.put(out, message)
        return _HEADER + out

    def put(self, out: bytearray, message: Any) -> None:
        """Append a message."""
        for value_of, put in self._leaves:
            put(out, value_of(message))

    @cached_property
    def _leaves(self) -> list[tuple[Callable[[Any], Any], Put]]:
        return [(attrgetter(path), put) for path, put in self._puts()]

    def _puts(self) -> Iterator[tuple[str, Put]]:
        """Yield the path to each field, through its parts, and what appends its value."""
        for base, many, field in self._fields:
            part = self._types.of_part(base)
            if part is not None and not many:
                yield from ((f"{field}.{path}", put) for path, put in part._puts())
            elif many and field in self.arrays:
                yield field, partial(_put_array, self.arrays[field], many == "[]")
            else:
                one = part.put if part else _put_text if base == "string" else _number(_FORMATS[base])
                yield field, partial(_put_list, one) if many else one


def _align(out: bytearray, size: int) -> None:
    out += bytes(-len(out) % size)


def _number(code: str) -> Put:
    number = struct.Struct("<" + code)

    def put(out: bytearray, value: Any) -> None:
        _align(out, number.size)
        out += number.pack(value)

    return put


_put_length = _number("I")


def _put_text(out: bytearray, text: str) -> None:
    data = text.encode() + b"\0"
    _put_length(out, len(data))
    out += data


def _put_array(kind: DTypeLike, is_counted: bool, out: bytearray, values: Any) -> None:
    array = np.asarray(values, kind)
    if is_counted:
        _put_length(out, array.size)
    if array.size:
        _align(out, array.itemsize)
        out += array.tobytes()


def _put_list(put: Put, out: bytearray, values: Iterable[Any]) -> None:
    found = list(values)
    _put_length(out, len(found))
    for value in found:
        put(out, value)
