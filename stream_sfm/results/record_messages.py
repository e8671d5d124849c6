"""The package's own ROS 2 messages: their definitions and their values follow from the records of `schema.py`.

| field of a record | fields of the message |
|---|---|
| int, float, str, bool | int64, float64, string, bool |
| list of int | int64[] |
| matrix of r × c | float64[r·c], row by row |
| list of such matrices | float64[], one after the other |
| dict of numbers by name | string[] `<field>_names`, and int64[] or float64[] `<field>` |
"""

from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
from msgspec import Meta

from ..wording import first_line

Record = TypeVar("Record", bound=msgspec.Struct)
_SCALARS = {bool: "bool", int: "int64", float: "float64", str: "string"}


@dataclass(frozen=True, slots=True)
class _Field:
    """A field of a record: `container` is None, list or dict; `shape` of the matrices, if it holds such."""

    name: str
    description: str
    kind: type
    container: type | None
    shape: tuple[int, ...] = ()

    @property
    def ros_type(self) -> str:
        """The type of the message's field of the same name."""
        scalar = _SCALARS[self.kind]
        if self.container is None:
            return f"{scalar}[{int(np.prod(self.shape))}]" if self.shape else scalar
        return f"{scalar}[]"

    def to_message(self, value: Any) -> dict[str, Any]:
        """Return the message's fields that hold this value."""
        if self.container is dict:
            return {f"{self.name}_names": list(value), self.name: self._numbers(list(value.values()))}
        return {self.name: self._numbers(value) if self.container is list or self.shape else value}

    def from_message(self, message: Any) -> Any:
        """Return the value that a message holds."""
        value = getattr(message, self.name)
        if self.container is dict:
            return dict(zip(getattr(message, f"{self.name}_names"), value.tolist(), strict=True))
        if self.shape:
            return value.reshape(self.shape if self.container is None else (-1, *self.shape)).tolist()
        return value.tolist() if self.container is list else value

    def _numbers(self, value: Any) -> Any:
        return np.asarray(value, dtype=_SCALARS[self.kind]).reshape(-1)


def definition(kind: type[msgspec.Struct]) -> str:
    """Return the text of the message of a record; each field is explained. The header gives the stamp and the frame."""
    lines = [f"# {first_line(kind)}", "std_msgs/Header header"]
    for field in _fields(kind):
        lines.append(f"# {field.description}")
        if field.container is dict:
            lines.append(f"string[] {field.name}_names")
        lines.append(f"{field.ros_type} {field.name}")
    return "\n".join(lines) + "\n"


def to_fields(record: msgspec.Struct) -> dict[str, Any]:
    """Return the values of a message's fields, without the header."""
    values: dict[str, Any] = {}
    for field in _fields(type(record)):
        values |= field.to_message(getattr(record, field.name))
    return values


def from_message(message: Any, kind: type[Record]) -> Record:
    """Return the record that a decoded message holds; fields that it lacks have their defaults.

    Raises TypeError where one without a default is missing, ValueError or AttributeError where one has another type.
    """
    found = [field for field in _fields(kind) if hasattr(message, field.name)]
    return kind(**{field.name: field.from_message(message) for field in found})


@cache
def _fields(kind: type[msgspec.Struct]) -> list[_Field]:
    hints = get_type_hints(kind, include_extras=True)
    return [_field(name, hints[name]) for name in kind.__struct_fields__]


def _field(name: str, hint: Any) -> _Field:
    hint, description, shape = _unwrapped(hint)
    container = get_origin(hint)
    if container is None or shape:
        return _Field(name, description, float if shape else hint, None, shape)
    inner, _, shape = _unwrapped(get_args(hint)[-1])
    return _Field(name, description, float if shape else inner, container, shape)


def _unwrapped(hint: Any) -> tuple[Any, str, tuple[int, ...]]:
    """Return a type without its annotations, its description in them, and the shape of its matrices."""
    description, shape = "", ()
    while get_origin(hint) is Annotated:
        hint, *metas = get_args(hint)
        for meta in metas:
            if isinstance(meta, Meta):
                description = meta.description or description
                shape = (meta.extra or {}).get("shape", shape)
    return hint, description, shape
