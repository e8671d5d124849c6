"""Decodes ROS messages by the definition that the log carries: ROS 1, or ROS 2 with msg or IDL."""

import re
from collections.abc import Callable, Iterable
from functools import lru_cache, partial
from types import SimpleNamespace
from typing import Any

from mcap.well_known import MessageEncoding, SchemaEncoding
from rosbags.interfaces import Msgdef, Nodetype
from rosbags.serde.cdr import generate_deserialize_cdr
from rosbags.serde.ros1 import generate_deserialize_ros1
from rosbags.typesys import get_types_from_idl, get_types_from_msg
from rosbags.typesys.base import normalize_fieldname
from rosbags.typesys.store import Typestore
from rosbags.typesys.stores import empty

from ...system.inputs import LIMITS, Decoder, bounded

_SEPARATOR = re.compile(r"^={3,}[ \t]*$", re.MULTILINE)  # between the definitions of a type and of its parts
_NOT_IDL = re.compile(r"^\s*(IDL:|#).*$", re.MULTILINE)  # the name of a part; preprocessor lines such as #include
_PLAIN_NAME = re.compile(r"[a-z]\w*/(?:msg/)?[A-Z]\w*", re.ASCII)
# A field of numbers, strings or named parts, or lists of them; or a constant that is a decimal number.
_PLAIN_LINE = re.compile(
    r"(?:bool|u?int(?:8|16|32|64)|float32|float64|string|[a-z]\w*/(?:msg/)?[A-Z]\w*)(?:\[\d{0,6}\])?[ \t]+[a-z]\w*"
    r"|u?int(?:8|16|32)[ \t]+[A-Z]\w*=-?\d{1,9}",
    re.ASCII,
)
# rosbags generates Python code from a definition, so a hostile one could demand any amount of it, or endless loops.
# These patterns apply to IDL without texts, comments and annotations. The time that rosbags takes for nested
# brackets is exponential in their number, and a few lines of constants can produce numbers without limit.
_IDL_TEXT = re.compile(r'"(?:[^"\\]|\\.)*"|//[^\n]*|/\*.*?\*/', re.DOTALL)
_IDL_ANNOTATION = re.compile(r"@[\w:]+\s*\([^()]*\)")
_IDL_HOSTILE = (
    (re.compile(r"[(*]"), "a constant that is computed with brackets or products"),
    # shifted by a number of three digits, or by an expression
    (re.compile(r"<<(?!\s*\d{1,2}\b)"), "a constant that would fill the memory"),
    (re.compile(r"\d{21}|0[xX][\da-fA-F]{17}"), "a number of more digits than 64 bits have"),
    (re.compile(r"\[\s*\["), "brackets in brackets"),
    (re.compile(r"(?:<[^<>;]*){5}"), "sequences nested too deeply"),
)
_SUPPORTED = (
    (MessageEncoding.CDR, SchemaEncoding.ROS2),
    (MessageEncoding.CDR, SchemaEncoding.ROS2IDL),
    (MessageEncoding.ROS1, SchemaEncoding.ROS1),
)
_MAKERS: dict[str, Callable[..., Any]] = {
    "deserialize_cdr_le": partial(generate_deserialize_cdr, endianness="le"),
    "deserialize_cdr_be": partial(generate_deserialize_cdr, endianness="be"),
    "deserialize_ros1": generate_deserialize_ros1,
}


class _Types(Typestore):
    """Types with only one of the functions in `_MAKERS`; decoded objects have the fields of a message, and no class.

    rosbags generates and compiles 13 functions per type, even if they are never called: many times as slow.
    """

    def __init__(self, function: str) -> None:
        super().__init__(empty)  # with times and durations, as ROS 1 does not define them
        self._function = function

    def get_msgdef(self, typename: str) -> Msgdef[object]:
        """Return the functions of a type; all others are None."""
        if typename not in self.cache:
            entries = [(normalize_fieldname(name), of) for name, of in self.fielddefs[typename][1]]
            made: dict[str, Any] = dict.fromkeys(Msgdef.__dataclass_fields__)
            names = [name for name, _ in entries]
            made |= {"name": typename, "fields": entries}
            made["cls"] = lambda *values: SimpleNamespace(**dict(zip(names, values, strict=False)))
            made[self._function] = _MAKERS[self._function](entries, self)
            self.cache[typename] = Msgdef(**made)
        return self.cache[typename]


@lru_cache(maxsize=32)  # a log is opened several times, and rosbags takes tens of milliseconds for a definition
def ros_decoder(message_encoding: str, schema_encoding: str, schema_name: str, definition: bytes) -> Decoder | None:
    """Return a function from the bytes of a message to an object with its fields; None for messages that are not ROS's.

    Both raise the errors of rosbags if the definition cannot be read or bytes do not fit.
    """
    if (message_encoding, schema_encoding) not in _SUPPORTED:
        return None
    if len(definition) > LIMITS.ros_definition_bytes:
        raise ValueError(f"a definition of {len(definition)} bytes")
    text = definition.decode("utf-8", "replace").replace("\r\n", "\n")
    types = _parse_types(text, schema_name, idl=schema_encoding == SchemaEncoding.ROS2IDL)
    _refuse_endless(types)
    package, *_, short_name = schema_name.split("/")
    name = f"{package}/msg/{short_name}"

    @lru_cache
    def store(function: str) -> _Types:
        made = _Types(function)
        made.fielddefs = types | made.fielddefs
        made.get_msgdef(name)
        return made

    def decode_ros1(data: bytes) -> Any:
        return store("deserialize_ros1").deserialize_ros1(data, name)

    def decode_cdr(data: bytes) -> Any:  # the second byte says which end is first; the big one hardly ever is
        return store("deserialize_cdr_be" if data[1:2] == b"\0" else "deserialize_cdr_le").deserialize_cdr(data, name)

    is_ros1 = message_encoding == MessageEncoding.ROS1
    # here, so that missing parts are reported for the schema, not for every message
    store("deserialize_ros1" if is_ros1 else "deserialize_cdr_le")
    decode = decode_ros1 if is_ros1 else decode_cdr
    return bounded(decode) if _has_repeated_parts(types) else decode


def _parse_types(text: str, schema_name: str, idl: bool) -> dict[str, Any]:
    if not idl:
        if (plain := _plain_types(text, schema_name)) is not None:
            return plain
        text = _SEPARATOR.sub("=" * 80, text)  # recorders differ in its length
        return dict(get_types_from_msg(text, schema_name))
    _refuse_hostile_idl(text)
    types: dict[str, Any] = {}
    for part in _SEPARATOR.split(text):
        if source := _NOT_IDL.sub("", part).strip():
            types |= get_types_from_idl(source)
    return types


def _plain_types(text: str, schema_name: str) -> dict[str, Any] | None:
    """Return the types of a definition in which all lines are plain, as nearly all are; None for another."""
    own, *parts = _SEPARATOR.split(text)
    named = [(schema_name, own)]
    for part in parts:
        head, _, lines = part.lstrip("\n").partition("\n")
        if not head.startswith("MSG: "):
            return None
        named.append((head.removeprefix("MSG: ").strip(), lines))
    types = {}
    for name, part in named:
        lines = [line.partition("#")[0].strip() for line in part.split("\n")]
        if not _PLAIN_NAME.fullmatch(name) or not all(not line or _PLAIN_LINE.fullmatch(line) for line in lines):
            return None
        types[name if "/msg/" in name else name.replace("/", "/msg/")] = _plain_type(lines)
    return types


def _plain_type(lines: Iterable[str]) -> Any:
    """Return constants and fields of a definition as rosbags does, whose parser of all there may be takes 20 ms."""
    constants, fields = [], []
    for kind, name in (line.partition("#")[0].split() for line in lines if line.partition("#")[0].strip()):
        name, is_constant, value = name.partition("=")
        kind, is_array, size = kind.rstrip("]").partition("[")
        if is_constant:
            constants.append((name, kind, int(value)))
            continue
        of: Any = (Nodetype.NAME, kind if "/msg/" in kind else kind.replace("/", "/msg/"))
        if "/" not in kind:
            of = (Nodetype.BASE, (kind, 0))
        if is_array:
            of = (Nodetype.ARRAY, (of, int(size))) if size else (Nodetype.SEQUENCE, (of, 0))
        fields.append((name, of))
    return constants, fields


def _refuse_hostile_idl(text: str) -> None:
    """Raise ValueError for IDL that would take a parser very long. No ROS message contains anything like it."""
    bare = _IDL_ANNOTATION.sub(" ", _IDL_TEXT.sub(" ", text))
    for hostile, what in _IDL_HOSTILE:
        if hostile.search(bare):
            raise ValueError(what)


def _has_repeated_parts(types: dict[str, Any]) -> bool:
    """Whether a type has a list of messages or strings; a list of numbers becomes one array."""
    return any(
        kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) and not _is_number(*of[0])
        for _, fields in types.values()
        for _, (kind, of) in fields
    )


def _is_number(element: Nodetype, what: Any) -> bool:
    return bool(element == Nodetype.BASE and what[0] != "string")


def _refuse_endless(types: dict[str, Any]) -> None:
    """Raise ValueError if rosbags would generate code for very many elements, or read elements without bytes.

    No ROS message of a camera, a pose or a transform has such a type.
    """
    for name, (_, fields) in types.items():
        if not fields:
            raise ValueError(f"type {name} is empty")
        for field, (kind, of) in fields:
            if kind != Nodetype.ARRAY:
                continue
            (element, what), length = of
            most = LIMITS.record_bytes if _is_number(element, what) else LIMITS.array_elements
            if not 1 <= length <= most:
                raise ValueError(f"field {field} of type {name} has {length} elements")
