"""Types of ROS 2 messages by their definitions, and the bytes of messages in CDR, little-endian.

rosbags encodes every type there is, and takes 40 ms at each start for the two dozen that are written here.
"""

import re
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property, partial
from itertools import groupby
from operator import attrgetter, itemgetter
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

_NUMBERS = "bool byte char int8 uint8 int16 uint16 int32 uint32 int64 uint64 float32 float64"
_FORMATS = dict(zip(_NUMBERS.split(), "?BBbBhHiIqQfd", strict=True))
_FIELD = re.compile(r"^([\w/]+)(\[\d*\])? (\w+)$", re.MULTILINE)  # constants have a value, comments begin with #
_HEADER = b"\0\1\0\0"  # little-endian, no parameters; positions count from behind it
_LENGTH = struct.Struct("<I")
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
        for value_of, put in self._puts:
            put(out, value_of(message))

    @cached_property
    def _puts(self) -> list[tuple[Callable[[Any], Any], Put]]:
        """What each field is, numbers of one size that follow each other together, and what appends it."""
        puts: list[tuple[Callable[[Any], Any], Put]] = []
        for size, leaves in groupby(self._leaves(), key=itemgetter(1)):
            paths, _, found = zip(*leaves, strict=True)
            if size:
                puts.append((_values_of(*paths), partial(_put_numbers, struct.Struct("<" + "".join(found)), size)))
            else:
                puts += zip(map(attrgetter, paths), found, strict=True)
        return puts

    def _leaves(self) -> Iterator[tuple[str, int, Any]]:
        """Yield the path to each field, through its parts; of a number its size and code, or else 0 and a Put."""
        for base, many, field in self._fields:
            part, code = self._types.of_part(base), _FORMATS.get(base)
            if part is not None and not many:
                yield from ((f"{field}.{path}", size, found) for path, size, found in part._leaves())
            elif code is not None and not many:
                yield field, struct.calcsize("<" + code), code
            elif code is not None:
                yield field, 0, partial(_put_array, self.arrays[field], many == "[]")
            else:
                one = _put_text if part is None else part.put
                yield field, 0, partial(_put_list, one) if many else one


def _values_of(*paths: str) -> Callable[[Any], Any]:
    values_of = attrgetter(*paths)
    return values_of if len(paths) > 1 else lambda message: (values_of(message),)


def _put_numbers(numbers: struct.Struct, size: int, out: bytearray, values: Iterable[Any]) -> None:
    out += bytes(-len(out) % size) + numbers.pack(*values)


def _put_text(out: bytearray, text: str) -> None:
    data = text.encode() + b"\0"
    out += bytes(-len(out) % 4) + _LENGTH.pack(len(data)) + data


def _put_array(kind: DTypeLike, is_counted: bool, out: bytearray, values: Any) -> None:
    array = np.asarray(values, kind)
    if is_counted:
        out += bytes(-len(out) % 4) + _LENGTH.pack(array.size)
    if array.size:
        out += bytes(-len(out) % array.itemsize) + array.tobytes()


def _put_list(put: Put, out: bytearray, values: Iterable[Any]) -> None:
    found = list(values)
    out += bytes(-len(out) % 4) + _LENGTH.pack(len(found))
    for value in found:
        put(out, value)
