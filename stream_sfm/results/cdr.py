"""ROS 2 messages in CDR, little-endian, by their definitions: texts with a field per line.

rosbags does it, too, but compiles functions for each type before the first message: 40 ms, half of what NumPy and
OpenCV take to be imported.
"""

import re
import struct
from collections.abc import Callable, Iterator, Mapping
from itertools import groupby
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

# The numbers of ROS, as `struct` and NumPy name them; also their sizes, to multiples of which they are aligned.
NUMBERS = {"bool": "?", "byte": "B", "uint8": "B", "int32": "i", "uint32": "I", "int64": "q", "float64": "d"}
_SIZES = {kind: struct.calcsize(code) for kind, code in NUMBERS.items()}
_LITTLE_ENDIAN = b"\0\1\0\0"
# A line of a definition that is neither a constant nor a comment.
_FIELD = re.compile(r"^(?P<kind>[\w/]+)(?:\[(?P<length>\d*)\])? (?P<key>\w+)$", re.MULTILINE)

Writer = Callable[[bytearray, Any], None]  # appends a part of a message


class FieldType(NamedTuple):
    """What a field holds: `kind`, a number, string, or type such as std_msgs/Header; `length` of an array of these, 0
    of one of any length, None where it is a single one."""

    kind: str
    length: int | None

    @property
    def size(self) -> int:
        """Bytes of a single number; 0 of anything else."""
        return _SIZES.get(self.kind, 0) if self.length is None else 0


def full_name(kind: str) -> str:
    """Return the name of a type in full: std_msgs/msg/Header for the std_msgs/Header of definitions."""
    return kind.replace("/", "/msg/")


class Encoder:
    """Encodes messages of the types in `definitions`, by full names, with the types of their parts."""

    def __init__(self, definitions: Mapping[str, str]) -> None:
        self._definitions = definitions
        self._fields: dict[str, dict[str, FieldType]] = {}
        self._writers: dict[str, list[Writer]] = {}

    def fields(self, name: str) -> dict[str, FieldType]:
        """Return the fields of a type (package/msg/Name) in order."""
        if name not in self._fields:
            self._fields[name] = {
                field["key"]: FieldType(
                    field["kind"], None if field["length"] is None else int(field["length"] or 0)
                )
                for field in _FIELD.finditer(self._definitions[name])
            }
        return self._fields[name]

    def encode(self, name: str, message: Any) -> bytes:
        """Return the bytes of a message, whose arrays are flat. Raises ValueError for one of a wrong length."""
        body = bytearray()  # parts are aligned to its beginning
        self._write(body, name, message)
        return _LITTLE_ENDIAN + body

    def _write(self, body: bytearray, name: str, message: Any) -> None:
        if name not in self._writers:
            self._writers[name] = list(self._made(name))
        for write in self._writers[name]:
            write(body, message)

    def _made(self, name: str) -> Iterator[Writer]:
        """Yield what writes a type: numbers of one size that follow each other at once, the rest one by one."""
        for size, of_size in groupby(self._flat(name), key=lambda field: field[1].size):
            fields = list(of_size)
            if size:
                yield _numbers(size, [path for path, _ in fields], [field.kind for _, field in fields])
            else:
                yield from (self._other(attrgetter(path), *field) for path, field in fields)

    def _flat(self, name: str) -> Iterator[tuple[str, FieldType]]:
        """Yield the fields of a type, with those of single parts in the place of these: pose.position.x."""
        for key, field in self.fields(name).items():
            if field.length is None and "/" in field.kind:
                yield from ((f"{key}.{path}", part) for path, part in self._flat(full_name(field.kind)))
            else:
                yield key, field

    def _other(self, get: Callable[[Any], Any], kind: str, length: int | None) -> Writer:
        def array(body: bytearray, message: Any) -> None:
            values = get(message)
            if not length:
                _add(body, 4, _COUNT.pack(len(values)))
            elif len(values) != length:
                raise ValueError(f"an array of {len(values)} numbers is one of {length} in the message")
            if kind in NUMBERS and len(values):
                _add(body, _SIZES[kind], np.asarray(values, f"<{NUMBERS[kind]}").tobytes())
            elif kind == "string":
                for text in values:
                    _add_string(body, text)
            elif "/" in kind:
                for part in values:
                    self._write(body, full_name(kind), part)

        return array if length is not None else lambda body, message: _add_string(body, get(message))


_COUNT = struct.Struct("<I")


def _add(body: bytearray, size: int, data: bytes) -> None:
    """Append numbers of one size, aligned to it."""
    body += bytes(-len(body) % size)
    body += data


def _add_string(body: bytearray, text: str) -> None:
    data = text.encode()
    _add(body, 4, _COUNT.pack(len(data) + 1))
    body += data + b"\0"


def _numbers(size: int, paths: list[str], kinds: list[str]) -> Writer:
    pack, get = struct.Struct("<" + "".join(NUMBERS[kind] for kind in kinds)).pack, attrgetter(*paths)
    if len(paths) == 1:
        return lambda body, message: _add(body, size, pack(get(message)))
    return lambda body, message: _add(body, size, pack(*get(message)))
