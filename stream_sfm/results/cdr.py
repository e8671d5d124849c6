"""ROS 2 messages without ROS, by rosbags: objects with their fields, definitions, and the bytes of each in CDR."""

from functools import cache
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from .own_messages import DEFINITIONS

_PART = "=" * 80  # between a definition and those of its parts


def make(name: str, /, **fields: Any) -> Any:
    """Make a message (package/msg/Name) of its fields; arrays become flat, and of the type of their numbers."""
    arrays = {field: np.asarray(fields[field], dtype).ravel() for field, dtype in _arrays(name)}
    return _store().types[name](**fields | arrays)


def encode(message: Any) -> bytes:
    """Return the bytes of a message: little-endian CDR."""
    return bytes(_store().serialize_cdr(message, message.__msgtype__))


def schema_text(name: str) -> str:
    """Return the definition of a message with those of all its parts; our own with an explanation of each field."""
    text, _ = _store().generate_msgdef(name, ros_version=2)
    return DEFINITIONS[name] + text[text.index(_PART) :] if name in DEFINITIONS else text


@cache
def _store() -> Typestore:
    """The standard messages used here, which are the same in every ROS 2, and our own."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store


@cache
def _arrays(name: str) -> list[tuple[str, str]]:
    """The fields of a message that are arrays of numbers, with the type of these."""
    found = []
    for field, (kind, content) in _store().fielddefs[name][1]:
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) and content[0][0] is Nodetype.BASE:
            number = content[0][1][0]
            found += [(field, number)] if number != "string" else []
    return found
