"""Encoded messages against rosbags, which has ROS's own definitions."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from stream_sfm.results.cdr import MessageTypes
from stream_sfm.results.own_messages import DEFINITIONS
from stream_sfm.results.ros_messages import encode, make, message_types, schema_text

STORE = get_typestore(Stores.ROS2_HUMBLE)
for name, text in DEFINITIONS.items():
    STORE.register(get_types_from_msg(text, name))
NUMBERS = {"bool": True, "byte": 7, "string": "ångström", "float64": -0.1}
# Every kind of field, at positions of every alignment.
DEFINITION = """\
# a comment of two words
uint8 CONSTANT=3
uint8 first
string[] texts
float64[] empty
int16[] shorts
test/msg/Part part
bool flag
test/msg/Part[] parts
float32[3] three
"""
PART = """\
byte one
int64 big
string text
"""


def message(name: str, sizes: np.random.Generator) -> Any:
    """A message of rosbags with other numbers in each field, and lists of up to three."""

    def value(kind: Any, of: Any) -> Any:
        match kind.name:
            case "BASE":
                return NUMBERS.get(of[0], int(sizes.integers(100)))
            case "NAME":
                return message(of, sizes)
        inner, length = of
        n = length if kind.name == "ARRAY" else int(sizes.integers(4))
        values = [value(*inner) for _ in range(n)]
        is_number = inner[0].name == "BASE" and inner[1][0] != "string"
        return np.array(values, inner[1][0] if inner[1][0] != "byte" else "u1") if is_number else values

    return STORE.types[name](**{field: value(*of) for field, of in STORE.fielddefs[name][1]})


@pytest.mark.parametrize("name", message_types())
def test_bytes_and_definitions_are_those_of_rosbags(name: str) -> None:
    for seed in range(5):
        given = message(name, np.random.default_rng(seed))
        fields = {field: getattr(given, field) for field, _ in STORE.fielddefs[name][1]}
        assert encode(make(name, **fields)) == bytes(STORE.serialize_cdr(given, name))
    # ROS's own definition: what is written may leave out constants, comments and names of the parts' own packages
    defined = get_types_from_msg(schema_text(name), name)
    assert all(defined[part][1] == STORE.fielddefs[part][1] for part in defined)


def test_every_kind_of_field_at_every_alignment() -> None:
    definitions = {"test/msg/All": DEFINITION.replace("/msg/", "/"), "test/msg/Part": PART}
    types = MessageTypes(definitions)
    for name, text in definitions.items():
        if name not in STORE.types:
            STORE.register(get_types_from_msg(text, name))
    for seed in range(20):
        given = message("test/msg/All", np.random.default_rng(seed))
        assert types["test/msg/All"].encoded(given) == bytes(STORE.serialize_cdr(given, "test/msg/All"))


def test_a_message_without_one_of_its_fields_is_not_written() -> None:
    with pytest.raises(AttributeError, match="nanosec"):
        encode(make("std_msgs/msg/Header", stamp=SimpleNamespace(sec=1), frame_id="left"))
