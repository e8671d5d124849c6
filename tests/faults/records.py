"""Records of MCAP files and of ROS 1 bags, made byte by byte, and sound logs that begin with some."""

import bz2
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import zstandard
from mcap.opcode import Opcode
from mcap_protobuf.schema import build_file_descriptor_set

from tests.helpers.stereo_logs import CONTAINERS, START_NS, Spec, write_log

MIB = 2**20
HEAD = struct.Struct("<BQ")  # kind, length of the body in bytes
MAGIC_BYTES = 8


def record(opcode: int, body: bytes) -> bytes:
    return HEAD.pack(opcode, len(body)) + body


def text(value: str | bytes) -> bytes:
    value = value.encode() if isinstance(value, str) else value
    return struct.pack("<I", len(value)) + value


def schema(number: int, name: str, encoding: str, definition: bytes) -> bytes:
    return record(Opcode.SCHEMA, struct.pack("<H", number) + text(name) + text(encoding) + text(definition))


def channel(number: int, schema_number: int, topic: str | bytes, encoding: str) -> bytes:
    ids = struct.pack("<HH", number, schema_number)
    return record(Opcode.CHANNEL, ids + text(topic) + text(encoding) + text(b""))


def message(number: int, data: bytes, stamp_ns: int = START_NS) -> bytes:
    return record(Opcode.MESSAGE, struct.pack("<HIQQ", number, 0, stamp_ns, stamp_ns) + data)


def chunk(records: bytes) -> bytes:
    data = zstandard.ZstdCompressor(level=1).compress(records)
    head = struct.pack("<QQQI", 0, 0, len(records), 0) + text("zstd")
    return record(Opcode.CHUNK, head + struct.pack("<Q", len(data)) + data)


def definition(kind: Any) -> bytes:
    return build_file_descriptor_set(kind).SerializeToString()


def insert(path: Path, records: Iterable[bytes], spec: Spec | None = None, container: str = "no index") -> None:
    """A sound log of 12 frames that begins with these records."""
    data = write_log(path, spec, **CONTAINERS[container]).read_bytes()
    head = MAGIC_BYTES + HEAD.size + HEAD.unpack_from(data, MAGIC_BYTES)[1]
    with path.open("wb") as stream:
        stream.write(data[:head])
        stream.writelines(records)
        stream.write(data[head:])


def bag_record(fields: dict[str, bytes], data: bytes) -> bytes:
    """A record of a ROS 1 bag."""
    header = b"".join(struct.pack("<I", len(n) + 1 + len(v)) + n.encode() + b"=" + v for n, v in fields.items())
    return text(header) + text(data)


def bag_chunk(content: bytes) -> bytes:
    fields = {"op": b"\x05", "compression": b"bz2", "size": struct.pack("<I", len(content))}
    return bag_record(fields, bz2.compress(content))


def bag_message(number: int) -> bytes:
    return bag_record({"op": b"\x02", "conn": struct.pack("<I", number), "time": bytes(8)}, b"")
