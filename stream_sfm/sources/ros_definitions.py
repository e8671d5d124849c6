"""Definitions of ROS 2's own message types, for recordings that carry none."""

from functools import lru_cache


@lru_cache(maxsize=64)
def standard_definition(schema_name: str) -> bytes:
    """The definition of a message type in ROS 2's format, with those of its parts; empty for other packages' types."""
    from rosbags.typesys import Stores, get_typestore

    # Messages of cameras, poses and transforms are the same in all distributions of ROS 2.
    store = get_typestore(Stores.ROS2_HUMBLE)
    if schema_name not in store.fielddefs:
        return b""
    text, _ = store.generate_msgdef(schema_name, ros_version=2)
    return text.encode()
