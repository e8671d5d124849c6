"""Small logs, what may happen to their bytes, and which frames must survive it.

The oracle knows nothing of our reader: the layout of a log is read off the *undamaged* file by mcap's own
`StreamReader`, and a frame is intact and leading where both its images, with everything before them, lie in front of
the first byte that changed.
"""

import io
import random
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk, get_chunk_data_stream
from mcap.writer import CompressionType

from tests.helpers.stereo_logs import CONTAINERS, START_NS, Spec, write_log

FRAMES = 5
_HEAD = struct.Struct("<BQ")
_MAGIC_BYTES = 8
_ODD_LENGTHS = (0, 1, 2**16, 2**31 - 1, 2**32 - 1, 2**40, 2**63 - 1, 2**64 - 1)

_NUMBERS = tuple(range(FRAMES))
_CHUNKED: dict[str, Any] = {"chunk_size": 6000}
BASES: dict[str, tuple[Spec, dict[str, Any]]] = {
    "protobuf, unchunked": (Spec("foxglove", "png", left=_NUMBERS, right=_NUMBERS), CONTAINERS["unchunked"]),
    "ROS 2, zstd": (
        Spec("ros2", "mono8", left=_NUMBERS, right=_NUMBERS), _CHUNKED | {"compression": CompressionType.ZSTD}
    ),
    "JSON, lz4, truth": (
        Spec("json", "jpeg", left=_NUMBERS, right=_NUMBERS, truth=True),
        _CHUNKED | {"compression": CompressionType.LZ4},
    ),
    "ROS 1, uncompressed chunks without checksums": (
        Spec("ros1", "mono8", left=_NUMBERS, right=_NUMBERS),
        _CHUNKED | {"compression": CompressionType.NONE, "enable_crcs": False},
    ),
    "protobuf, no index": (
        Spec("foxglove", "jpeg", left=_NUMBERS, right=_NUMBERS), CONTAINERS["no index"] | _CHUNKED
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Record:
    """One record of the file: the bytes `data[start:end]`."""

    opcode: int
    start: int
    end: int


@dataclass(frozen=True)
class Base:
    """An undamaged log. `frame_ends`: stamp of a frame, ns -> where the last record that it needs ends."""

    data: bytes

    @cached_property
    def records(self) -> list[Record]:
        """The records of the file, those in chunks not opened."""
        found, at = [], _MAGIC_BYTES
        while at < len(self.data) - _MAGIC_BYTES:
            opcode, length = _HEAD.unpack_from(self.data, at)
            found.append(Record(opcode, at, at + _HEAD.size + length))
            at = found[-1].end
        return found

    @cached_property
    def frame_ends(self) -> dict[int, int]:
        """By mcap's reader, which counts the bytes that it has taken."""
        ends: dict[int, list[int]] = {}
        cameras: set[int] = set()
        stream = io.BytesIO(self.data)
        for record in StreamReader(stream, emit_chunks=True).records:
            for inner in breakup_chunk(record) if isinstance(record, Chunk) else [record]:
                if isinstance(inner, Channel) and "image" in inner.topic:
                    cameras.add(inner.id)
                if isinstance(inner, Message) and inner.channel_id in cameras:
                    ends.setdefault(inner.log_time, []).append(stream.tell())
        return {stamp: max(both) for stamp, both in ends.items() if len(both) == 2}

    @cached_property
    def checksummed(self) -> bool:
        """Whether each message lies in a chunk with a checksum and is counted, so that no loss is hidden."""
        records = StreamReader(io.BytesIO(self.data), emit_chunks=True).records
        crcs = [r.uncompressed_crc for r in records if isinstance(r, Chunk)]
        return bool(crcs) and all(crcs) and any(r.opcode == Opcode.STATISTICS for r in self.records)

    def leading(self, damaged: bytes) -> list[int]:
        """The stamps of the frames that lie whole before the first byte in which `damaged` differs."""
        same = min(len(self.data), len(damaged))
        if self.data[:same] != damaged[:same]:
            # halving: compare slices instead of bytes
            low, high = 0, same
            while high - low > 1:
                middle = (low + high) // 2
                low, high = (middle, high) if self.data[:middle] == damaged[:middle] else (low, middle)
            same = low
        return [stamp for stamp, end in self.frame_ends.items() if end <= same]


def make_base(name: str, folder: Path) -> Base:
    """Write the log of that name, and read its layout."""
    spec, container = BASES[name]
    base = Base(write_log(folder / "base.mcap", spec, **container).read_bytes())
    assert sorted(base.frame_ends) == [START_NS + n * 100_000_000 for n in range(FRAMES)]
    return base


def flip(rng: random.Random, base: Base, data: bytearray) -> None:
    """A few bits or bytes anywhere."""
    if not data:
        return
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(len(data))
        data[at] = data[at] ^ 1 << rng.randrange(8) if rng.random() < 0.5 else rng.randrange(256)


def cut(rng: random.Random, base: Base, data: bytearray) -> None:
    """The end is missing."""
    del data[rng.randrange(len(data)) :]


def splice(rng: random.Random, base: Base, data: bytearray) -> None:
    """A stretch is missing, doubled, zeroed, or replaced by noise or by another stretch of the file."""
    length = min(int(2 ** rng.uniform(0, 14)), len(data))
    start, other = (rng.randrange(len(data) - length + 1) for _ in range(2))
    stretch = bytes(data[other : other + length])
    replacement, removed = rng.choice(
        [(b"", length), (stretch, 0), (bytes(length), length), (rng.randbytes(length), length), (stretch, length)]
    )
    data[start : start + removed] = replacement


def swap_records(rng: random.Random, base: Base, data: bytearray) -> None:
    """Two records of the file change places, or one comes twice, or goes."""
    first, second = sorted(rng.sample(base.records, 2), key=lambda r: r.start)
    a, b = base.data[first.start : first.end], base.data[second.start : second.end]
    middle = base.data[first.end : second.start]
    data[first.start : second.end] = rng.choice([b + middle + a, a + a + middle + b, middle + b, a + middle + a])


def lengthen(rng: random.Random, base: Base, data: bytearray) -> None:
    """A length field tells something else: of a record, or one inside it."""
    record = rng.choice(base.records)
    field, size = rng.choice([(1, 8), (1, 8), (_HEAD.size + 16, 8), (_HEAD.size + 28, 4), (_HEAD.size + 36, 8)])
    at = record.start + field
    if at + size > record.end:
        at, size = record.start + 1, 8
    told = int.from_bytes(data[at : at + size], "little")
    value = rng.choice([*_ODD_LENGTHS, max(told + rng.randint(-40, 40), 0), told * 2, rng.getrandbits(24)])
    data[at : at + size] = (value % 2 ** (8 * size)).to_bytes(size, "little")


def change_inside(rng: random.Random, base: Base, data: bytearray) -> None:
    """Bytes inside a chunk change and its checksum with them: hostile, not damaged. Else inside a record."""
    record = rng.choice(base.records)
    body = bytearray(data[record.start + _HEAD.size : record.end])
    if record.opcode != Opcode.CHUNK:
        flip(rng, base, body)
        data[record.start + _HEAD.size : record.end] = body
        return
    start, end = struct.unpack_from("<QQ", body)
    stream, size = get_chunk_data_stream(Chunk.read(ReadDataStream(io.BytesIO(body))))
    content = bytearray(stream.read(size))
    for _ in range(rng.randint(1, 3)):
        rng.choice([flip, splice])(rng, base, content)
    packed = zstandard.compress(content)
    head = struct.pack("<QQQI", start, end, len(content), zlib.crc32(content))
    body = bytearray(head + struct.pack("<I4sQ", 4, b"zstd", len(packed)) + packed)
    data[record.start : record.end] = _HEAD.pack(Opcode.CHUNK, len(body)) + body


MUTATIONS: tuple[Callable[[random.Random, Base, bytearray], None], ...] = (
    flip, cut, splice, swap_records, lengthen, change_inside,
)  # fmt: skip


def mutate(base: Base, seed: int) -> tuple[str, bytes]:
    """What was done, and the damaged file. Each kind of damage comes equally often."""
    rng = random.Random(seed)
    data = bytearray(base.data)
    kind = MUTATIONS[seed % len(MUTATIONS)]
    kind(rng, base, data)
    if rng.random() < 0.2:
        flip(rng, base, data)
    return kind.__name__, bytes(data)
