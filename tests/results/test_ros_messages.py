"""The definitions of messages, read without the parser of rosbags."""

from rosbags.typesys import get_types_from_msg

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
