"""Decodes protobuf messages by the definition that the log carries.

Only logs with such messages import it, as its libraries take a twentieth of a second.
"""

from typing import Any

from google.protobuf.descriptor import Descriptor
from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory

from ...system.inputs import Decoder, bounded
from ..mcap_file.message import Channel


def protobuf_decoder(channel: Channel) -> Decoder | None:
    """Return a function from the bytes of a message to an object with its fields; None for other schemas.

    Both raise the errors of the library if the definition cannot be read or bytes do not fit.
    """
    schema = Schema(1, channel.definition, channel.schema_encoding, channel.schema_name)
    decoder: Any = DecoderFactory().decoder_for(channel.message_encoding, schema)
    if decoder is None:
        return None
    return bounded(decoder) if _has_repeated_fields(decoder(b"").DESCRIPTOR) else decoder


def _has_repeated_fields(descriptor: Descriptor) -> bool:
    """Whether a message, or any message within it, has a repeated field."""
    seen, left = {descriptor.full_name}, [descriptor]
    while left:
        one = left.pop()
        proto = DescriptorProto()
        one.CopyToProto(proto)  # the descriptor itself names it differently in each version of protobuf
        if any(field.label == FieldDescriptorProto.LABEL_REPEATED for field in proto.field):
            return True
        for field in one.fields:
            if field.message_type is not None and field.message_type.full_name not in seen:
                seen.add(field.message_type.full_name)
                left.append(field.message_type)
    return False
