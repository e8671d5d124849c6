"""Bounds on messages with repeated fields: each element of a byte or two becomes an object of about a hundred bytes.

The pixels of an image are one field of bytes and are not bounded here. JSON has no definition that says which fields
repeat, so its values are counted before it is parsed.
"""

import json
from collections.abc import Callable
from typing import Any

from google.protobuf.descriptor import Descriptor
from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto

MAX_REPEATED_BYTES = 2**20  # of a message with repeated fields: some ten thousand transforms
_MAX_JSON_VALUES = 2**22  # as many as a list of the pixels of a 4-megapixel image has
_MAX_JSON_TEXT_BYTES = 2**24  # of text that is not ASCII, which Python may widen to four bytes; base64 is ASCII
Decoder = Callable[[bytes], Any]


def bounded(decoder: Decoder) -> Decoder:
    """A decoder for a definition with repeated fields; it raises ValueError for messages over the bound."""

    def decode(data: bytes) -> Any:
        if len(data) > MAX_REPEATED_BYTES:
            raise ValueError(
                f"its definition has repeated fields, and it is over {MAX_REPEATED_BYTES // 2**20} MiB"
            )
        return decoder(data)

    return decode


def has_repeated_fields(descriptor: Descriptor) -> bool:
    """Whether a protobuf message, or any message within it, has a repeated field."""
    seen, left = {descriptor.full_name}, [descriptor]
    while left:
        one = left.pop()
        proto = DescriptorProto()
        one.CopyToProto(proto)  # the descriptor itself has other names for it in each version of protobuf
        if any(field.label == FieldDescriptorProto.LABEL_REPEATED for field in proto.field):
            return True
        for field in one.fields:
            if field.message_type is not None and field.message_type.full_name not in seen:
                seen.add(field.message_type.full_name)
                left.append(field.message_type)
    return False


def decode_json(data: bytes) -> Any:
    """Parse JSON like `json.loads`. Raises ValueError for more values than any message has."""
    values = sum(data.count(mark) for mark in (b",", b"[", b"{"))  # an upper bound: text may contain them too
    if values > _MAX_JSON_VALUES:
        raise ValueError(f"up to {values} values")
    if len(data) > _MAX_JSON_TEXT_BYTES and not data.isascii():
        raise ValueError("a long text that is not ASCII")
    return json.loads(data)
