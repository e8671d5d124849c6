"""Decoding of ROS 1 messages in MCAP (schema encoding ros1msg), from the definition that the log carries.

ROS 1 stores fields one after the other, little-endian, without padding; strings and open arrays carry a 32-bit
count. No maintained package on PyPI decodes this without a ROS installation, and this is all there is to it.
"""

import re
import struct
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

_PRIMITIVES = {
    "bool": "?", "int8": "b", "byte": "b", "uint8": "B", "char": "B", "int16": "h", "uint16": "H", "int32": "i",
    "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
_FIELD = re.compile(r"^([\w/]+)(\[(\d*)\])?\s+(\w+)\s*$")
_Field = tuple[str, str, bool, int | None]  # name, type, is array, fixed length


def ros1_decoder(name: str, definition: str) -> Callable[[bytes], SimpleNamespace]:
    """A function from the bytes of one `name` message (package/Type) to a namespace of its fields.

    Raises ValueError where the definition cannot be read or lacks a type; the decoder raises ValueError or
    struct.error on bytes that do not fit.
    """
    types = _parse(name, definition)

    def decode(data: bytes) -> SimpleNamespace:
        return _read_type(types, name, data, 0)[0]

    return decode


def _parse(name: str, definition: str) -> dict[str, list[_Field]]:
    types: dict[str, list[_Field]] = {}
    names = {name}
    sections = re.split(r"^={3,}\s*$", definition, flags=re.MULTILINE)
    parsed: list[tuple[str, str]] = []
    for i, section in enumerate(sections):
        header = re.match(r"\s*MSG:\s*(\S+)\s*\n?", section)
        if i and header is None:
            raise ValueError(f"definition of {name}: a part without its MSG line")
        full = name if header is None else header.group(1)
        names.add(full)
        parsed.append((full, section[header.end() :] if header else section))
    for full, text in parsed:
        types[full] = _fields(full, text, names)
    return types


def _fields(full: str, text: str, names: set[str]) -> list[_Field]:
    fields: list[_Field] = []
    for raw in text.splitlines():
        line = raw.split("#")[0].strip()
        if not line or "=" in line:  # constants are not stored
            continue
        match = _FIELD.match(line)
        if match is None:
            raise ValueError(f"definition of {full}: cannot read the line {line!r}")
        kind, array, count, field = match.groups()
        if kind not in _PRIMITIVES and kind not in ("string", "time", "duration"):
            package = full.split("/")[0]
            wanted = "std_msgs/Header" if kind == "Header" else kind
            found = [n for n in (wanted, f"{package}/{wanted}") if n in names]
            if not found:
                raise ValueError(f"definition of {full}: type {kind} is not described")
            kind = found[0]
        fields.append((field, kind, array is not None, int(count) if count else None))
    return fields


def _read_type(types: dict[str, list[_Field]], name: str, data: bytes, at: int) -> tuple[SimpleNamespace, int]:
    message = SimpleNamespace()
    for field, kind, is_array, count in types[name]:
        value: Any
        if not is_array:
            value, at = _read_one(types, kind, data, at)
        else:
            if count is None:
                (count,) = struct.unpack_from("<I", data, at)
                at += 4
            if kind in ("uint8", "char"):
                value, at = data[at : at + count], at + count
                if len(value) < count:
                    raise ValueError(f"{field} claims {count} bytes, {len(value)} are left")
            elif kind in _PRIMITIVES:
                size = count * struct.calcsize("<" + _PRIMITIVES[kind])
                if size > len(data) - at:
                    raise ValueError(f"{field} claims {count} elements, more than are left")
                value = list(struct.unpack_from(f"<{count}{_PRIMITIVES[kind]}", data, at))
                at += size
            else:
                value = []
                for _ in range(count):
                    element, at = _read_one(types, kind, data, at)
                    value.append(element)
        setattr(message, field, value)
    return message, at


def _read_one(types: dict[str, list[_Field]], kind: str, data: bytes, at: int) -> tuple[Any, int]:
    if kind in _PRIMITIVES:
        code = "<" + _PRIMITIVES[kind]
        return struct.unpack_from(code, data, at)[0], at + struct.calcsize(code)
    if kind == "string":
        (count,) = struct.unpack_from("<I", data, at)
        text = data[at + 4 : at + 4 + count]
        if len(text) < count:
            raise ValueError(f"a string claims {count} bytes, {len(text)} are left")
        return text.decode("utf-8", "replace"), at + 4 + count
    if kind in ("time", "duration"):
        sec, nsec = struct.unpack_from("<II" if kind == "time" else "<ii", data, at)
        return SimpleNamespace(sec=sec, nsec=nsec), at + 8
    return _read_type(types, kind, data, at)
