"""The types of messages that are written, compared with those that rosbags reads from their definitions."""

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from stream_sfm.results.own_messages import DEFINITIONS
from stream_sfm.results.ros_types import Types

TYPES = Types()
ROS = get_typestore(Stores.ROS2_HUMBLE)


def test_the_standard_types_are_those_of_ros() -> None:
    standard = TYPES.fields.keys() - DEFINITIONS.keys()
    assert standard and all(TYPES.fields[name] == ROS.fielddefs[name][1] for name in standard)


def test_our_own_types_are_read_as_rosbags_reads_them() -> None:
    for name, definition in DEFINITIONS.items():
        assert TYPES.fields[name] == get_types_from_msg(definition, name)[name][1]


@pytest.mark.parametrize("name", TYPES.fields)
def test_a_schema_says_the_type_and_all_its_parts(name: str) -> None:
    found = get_types_from_msg(TYPES.schema_text(name), name)
    standard = {each: fields for each, fields in found.items() if each not in DEFINITIONS}
    assert found[name][1] == TYPES.fields[name] and standard == {each: ROS.fielddefs[each] for each in standard}
    used = {
        of[0][1] if isinstance(of, tuple) and len(of) == 2 and isinstance(of[0], tuple) else of
        for _, fields in found.values()
        for _, (_, of) in fields
    }
    assert {each for each in used if isinstance(each, str)} <= found.keys()
