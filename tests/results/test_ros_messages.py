"""Definitions and bytes of messages, which rosbags reads and writes the same."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from stream_sfm import core
from stream_sfm.logs.recording import ros
from stream_sfm.results import ros_messages
from stream_sfm.results.own_messages import DEFINITIONS

NAMES = tuple(ros_messages._definitions())


@pytest.fixture(scope="module")
def store() -> Any:
    """Our messages and the standard ones, as rosbags knows them."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store


def any_message(rng: np.random.Generator, fields: tuple[ros_messages.Field, ...]) -> Any:
    """Random values in all fields."""

    def value(kind: Any) -> Any:
        if isinstance(kind, tuple):
            return any_message(rng, kind)
        if kind == "s":
            return "σ" * int(rng.integers(0, 4)) + "abc"[: int(rng.integers(0, 4))]
        return rng.integers(0, 2 if kind == "?" else 100, dtype=np.uint8).astype(kind).item()

    found = {}
    for name, kind, count, size in fields:
        several = 0 if count is None else count if count > 0 else int(rng.integers(0, 4))
        each = [value(kind) for _ in range(several)]
        found[name] = value(kind) if count is None else np.array(each, np.dtype(kind)) if size else each
    return SimpleNamespace(**found)


def as_rosbags(store: Any, name: str, message: Any) -> Any:
    """The same message of the class of rosbags, which checks the types of parts."""
    values = {}
    for field, kind, count, _ in ros_messages.fields_of(name):
        part = getattr(message, field)
        if isinstance(kind, tuple):
            of = next(p for p in NAMES if ros_messages.fields_of(p) is kind)
            part = as_rosbags(store, of, part) if count is None else [as_rosbags(store, of, p) for p in part]
        values[field] = part
    return store.types[name](**values)


@pytest.mark.parametrize("name", NAMES)
def test_messages_have_the_bytes_and_the_definition_of_rosbags(name: str, store: Any) -> None:
    rng = np.random.default_rng(0)
    messages = [any_message(rng, ros_messages.fields_of(name)) for _ in range(20)]
    found = core.encoded(len(messages) * [ros_messages.fields_of(name)], messages)
    for message, content in zip(messages, found, strict=True):
        assert content == bytes(store.serialize_cdr(as_rosbags(store, name, message), name))
    text, _ = store.generate_msgdef(name, ros_version=2)
    without_comments = "\n".join(line for line in ros_messages.schema_text(name).split("\n") if line[:1] != "#")
    assert without_comments == text


@pytest.mark.parametrize(
    ("fields", "value", "error"),
    [
        (("i", None, 0), 2**31, ValueError),
        (("B", None, 0), -1, ValueError),
        (("i", None, 0), 1.5, TypeError),
        (("d", None, 0), "1", TypeError),
        (("s", None, 0), 1, TypeError),
        (("s", None, 0), "\ud800", UnicodeEncodeError),
        (("x", None, 0), 1, ValueError),
        (("d", 3, 8), np.zeros(2), ValueError),
        (("d", -1, 8), np.zeros(3, np.float32), ValueError),
        (("d", -1, 8), np.zeros((4, 4))[:, 0], ValueError),
        (("d", -1, 8), [1.0], TypeError),
        (("s", -1, 0), 5, TypeError),
    ],
)
def test_a_value_that_its_field_cannot_hold_is_refused(fields: Any, value: Any, error: type[Exception]) -> None:
    with pytest.raises(error):
        core.encoded([(("of", *fields),)], [SimpleNamespace(of=value)])
    with pytest.raises(AttributeError):
        core.encoded([(("other", *fields),)], [SimpleNamespace(of=value)])


def test_plain_definitions_of_logs_are_read_as_rosbags_reads_them(store: Any) -> None:
    """All standard ones of ROS 2 that have only plain lines, which are most; the others are left to rosbags."""
    plain = 0
    for name in store.fielddefs:
        text, _ = store.generate_msgdef(name, ros_version=2)
        found = ros._plain_types(text, name)
        plain += found is not None
        assert found is None or found == get_types_from_msg(text, name), name
    assert plain > 0.8 * len(store.fielddefs)


@pytest.mark.parametrize(
    "text",
    [
        "Header header\n",
        "string<=5 name\n",
        'string NAME="a # b"\n',
        "int32 number 5\n",
        "time stamp\n",
        "float64[<=3] list\n",
        "float64[9999999] list\n",
        "uint8 A=0x10\n",
        "int32 a\n===\nint32 b\n",
    ],
)
def test_unusual_definitions_are_left_to_rosbags(text: str) -> None:
    assert ros._plain_types(text, "a_msgs/msg/A") is None
