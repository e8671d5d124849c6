"""The definitions of messages, read without the parser of rosbags."""

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from stream_sfm.logs.recording import ros
from stream_sfm.results import ros_messages
from stream_sfm.results.own_messages import DEFINITIONS


def test_definitions_are_read_as_rosbags_reads_them() -> None:
    standard = (line.split(": ", 1) for line in ros_messages._STANDARD.splitlines())
    texts = {name.replace("/", "/msg/"): fields.replace(", ", "\n") for name, fields in standard} | DEFINITIONS
    known = ros_messages.type_store().fielddefs
    for name, text in texts.items():
        assert known[name] == get_types_from_msg(text, name)[name], name
    kinds = {of[0] for _, fields in (known[name] for name in texts) for _, of in fields}
    assert len(kinds) == 4 and any(constants for constants, _ in (known[name] for name in texts))  # all that there are


def test_plain_definitions_of_logs_are_read_as_rosbags_reads_them() -> None:
    """All standard ones of ROS 2 that have only plain lines, which are most; the others are left to rosbags."""
    store = get_typestore(Stores.ROS2_HUMBLE)
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
