"""Messages that hold lists are bounded: each element of a byte or two becomes an object of a hundred.

An image is one field of bytes and takes what it takes; of JSON, whose lists no definition tells, the values are
counted before it is read.
"""

import json
from collections.abc import Callable
from typing import Any

from google.protobuf.descriptor import Descriptor
from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto

MAX_LISTED_BYTES = 2**20  # some ten thousand transforms
_MAX_JSON_VALUES = 2**22
_MAX_JSON_TEXT_BYTES = 2**24  # that is not ASCII, which Python may widen to four bytes a character; base64 is
Decoder = Callable[[bytes], Any]


def bounded(decoder: Decoder) -> Decoder:
    """`decoder`, for a definition that has lists: it raises ValueError for a message that is too long for one."""

    def decode(data: bytes) -> Any:
        if len(data) > MAX_LISTED_BYTES:
            raise ValueError(f"its definition has lists, and it is over {MAX_LISTED_BYTES // 2**20} MiB")
        return decoder(data)

    return decode


def has_lists(descriptor: Descriptor) -> bool:
    """Whether a protobuf message, or any within it, has a repeated field."""
    seen, left = {descriptor.full_name}, [descriptor]
    while left:
        one = left.pop()
        proto = DescriptorProto()
        one.CopyToProto(proto)  # the descriptor itself tells it by other names in each version of protobuf
        if any(field.label == FieldDescriptorProto.LABEL_REPEATED for field in proto.field):
            return True
        for field in one.fields:
            if field.message_type is not None and field.message_type.full_name not in seen:
                seen.add(field.message_type.full_name)
                left.append(field.message_type)
    return False


def decode_json(data: bytes) -> Any:
    """As `json.loads`. Raises ValueError for more values than an image has pixels."""
    values = sum(data.count(mark) for mark in (b",", b"[", b"{"))  # at most: text may hold them too
    if values > _MAX_JSON_VALUES:
        raise ValueError(f"up to {values} values")
    if len(data) > _MAX_JSON_TEXT_BYTES and not data.isascii():
        raise ValueError("a long text that is not ASCII")
    return json.loads(data)
