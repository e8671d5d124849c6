"""Damage to logs of every layout, in three states of their index, and the frames that each leaves intact.

The oracle knows nothing of our reader: the layout is read off the *undamaged* file by mcap's own `StreamReader`, and a
frame is intact where nothing was done to the chunks, or else the messages, that hold its images.
"""

import io
import random
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk, get_chunk_data_stream

from stream_sfm.mcap_file.damage import Damage
from stream_sfm.mcap_file.log_file import LogFile
from stream_sfm.recording.stereo_log import open_log
from tests.faults.records import HEAD, MAGIC_BYTES, record

_NO_SUMMARY = record(Opcode.DATA_END, bytes(4)) + record(Opcode.FOOTER, bytes(20))

Span = tuple[int, int]  # bytes [start, end) of a file
# Changes the data in place, and returns what it has hit of the undamaged file; an empty span lies between two bytes.
Change = Callable[[random.Random, "Whole", bytearray], list[Span]]


@dataclass(frozen=True)
class Whole:
    """An undamaged log. `records`: kind and bytes of those at the top; `frames`: log time -> where the images are.

    `pieces`: the chunks, or the messages where there are none; `checksums`: of messages with images, by topic and time.
    """

    data: bytes
    topics: frozenset[str]
    records: list[tuple[int, Span]]
    pieces: list[Span]
    frames: dict[int, set[Span]]
    checksums: dict[tuple[str, int], int]
    checksummed: bool  # so that nothing that has changed may be taken for what was recorded

    def of_kind(self, opcode: int) -> list[Span]:
        return [span for kind, span in self.records if kind == opcode]

    @property
    def data_end(self) -> int:
        """Offset of the record behind the last message."""
        return self.of_kind(Opcode.DATA_END)[0][0]

    def intact(self, hit: list[Span]) -> set[int]:
        """The frames whose pieces are not hit."""
        bad = {(a, b) for a, b in self.pieces if any(a < end and start < b for start, end in hit)}
        return {frame for frame, pieces in self.frames.items() if not pieces & bad}


def whole_log(path: Path) -> Whole:
    """Read the layout of an undamaged log, by mcap's own reader."""
    data, log = path.read_bytes(), open_log(path)
    topics = frozenset((log.left_topic, log.right_topic))
    records, at = list[tuple[int, Span]](), MAGIC_BYTES
    while at < len(data) - MAGIC_BYTES:
        kind, length = HEAD.unpack_from(data, at)
        records.append((kind, (at, at := at + HEAD.size + length)))
    stream, cameras, pieces = io.BytesIO(data), dict[int, str](), list[Span]()
    sides: dict[int, list[Span]] = {}
    checksums: dict[tuple[str, int], int] = {}
    summed, at = [], MAGIC_BYTES
    for found in StreamReader(stream, emit_chunks=True).records:
        span = at, stream.tell()
        at = span[1]
        if isinstance(found, Chunk | Message):
            pieces.append(span)
            summed.append(isinstance(found, Chunk) and found.uncompressed_crc != 0)
        for inner in breakup_chunk(found) if isinstance(found, Chunk) else [found]:
            if isinstance(inner, Channel) and inner.topic in topics:
                cameras[inner.id] = inner.topic
            elif isinstance(inner, Message) and inner.channel_id in cameras:
                sides.setdefault(inner.log_time, []).append(span)
                checksums[cameras[inner.channel_id], inner.log_time] = zlib.crc32(inner.data)
    frames = {stamp: set(both) for stamp, both in sides.items() if len(both) == len(topics)}
    assert frames, f"{path} has no frames of two images at one time"
    return Whole(data, topics, records, pieces, frames, checksums, all(summed))


def _somewhere(rng: random.Random, whole: Whole, count: int) -> int:
    """Where `count` bytes of the data section begin."""
    return rng.randrange(MAGIC_BYTES, max(whole.data_end - count, MAGIC_BYTES + 1))


def _overwrite(content: Callable[[random.Random, int], bytes]) -> Change:
    def change(rng: random.Random, whole: Whole, data: bytearray) -> list[Span]:
        count = min(2**20, len(whole.data) // 10)
        at = _somewhere(rng, whole, count)
        data[at : at + count] = content(rng, count)
        return [(at, at + count)]

    return change


def _remove(most: int) -> Change:
    def change(rng: random.Random, whole: Whole, data: bytearray) -> list[Span]:
        count = min(most, len(whole.data) // 10)
        at = _somewhere(rng, whole, count)
        del data[at : at + count]
        return [(at, at + count)]

    return change


def _insert_byte(rng: random.Random, whole: Whole, data: bytearray) -> list[Span]:
    at = _somewhere(rng, whole, 1)
    data[at:at] = rng.randbytes(1)
    return [(at, at)]


def _double(rng: random.Random, whole: Whole, data: bytearray) -> list[Span]:
    count = min(2**16, len(whole.data) // 10)
    at = _somewhere(rng, whole, count)
    data[at:at] = data[at : at + count]
    return [(at + count, at + count)]


def _wrong_length(rng: random.Random, whole: Whole, data: bytearray) -> list[Span]:
    start, end = rng.choice(whole.pieces)
    length = end - start - HEAD.size
    wrong = rng.choice([0, 7, length - 1, length + 1, length // 2, 3 * length, 2**40, 2**64 - 1])
    data[start + 1 : start + 9] = (wrong % 2**64).to_bytes(8, "little")
    # it is given a second time inside a chunk
    return [] if data[start] == Opcode.CHUNK else [(start, end)]


def _wrong_kind(rng: random.Random, whole: Whole, data: bytearray) -> list[Span]:
    start, end = rng.choice(whole.pieces)
    chunk = data[start] == Opcode.CHUNK
    data[start] = rng.choice([1, 2, 7, 9, 12, 15, 16, 127, 128, 255])
    return [] if chunk else [(start, end)]  # the content of the chunk shows that it is one


def _flip_bits(rng: random.Random, whole: Whole, data: bytearray) -> list[Span]:
    places = [_somewhere(rng, whole, 1) for _ in range(10)]
    for at in places:
        data[at] ^= 1 << rng.randrange(8)
    return [(at, at + 1) for at in places]


def _swap(rng: random.Random, whole: Whole, data: bytearray) -> list[Span]:
    """Two pieces change places, or one comes twice."""
    (a, b), (c, d) = sorted(rng.sample(whole.pieces, 2))
    first, middle, second = data[a:b], data[b:c], data[c:d]
    data[a:d] = rng.choice([second + middle + first, first + first + middle + second])
    return [(a, b), (c, d)]


def _change_inside(rng: random.Random, whole: Whole, data: bytearray) -> list[Span]:
    """Bytes inside a piece change, in a chunk its checksum with them: hostile, not damaged."""
    start, end = rng.choice(whole.pieces)
    body = bytes(data[start + HEAD.size : end])
    if data[start] == Opcode.CHUNK:
        chunk = Chunk.read(ReadDataStream(io.BytesIO(body)))
        stream, size = get_chunk_data_stream(chunk)
        content = bytearray(stream.read(size))
    else:
        content = bytearray(body)
    at, length = rng.randrange(len(content)), rng.choice((1, 4, 50))
    content[at : at + length] = rng.choice((rng.randbytes(length), bytes(length), b"", content[at:][:length] * 2))
    if data[start] == Opcode.CHUNK:
        packed = zstandard.compress(content)
        head = struct.pack(
            "<QQQI", chunk.message_start_time, chunk.message_end_time, len(content), zlib.crc32(content)
        )
        content = bytearray(head + struct.pack("<I4sQ", 4, b"zstd", len(packed)) + packed)
    data[start:end] = record(data[start], bytes(content))
    return [(start, end)]


def _cut(rng: random.Random, whole: Whole, data: bytearray) -> list[Span]:
    at = _somewhere(rng, whole, 1)
    del data[at:]
    return [(at, len(whole.data))]


KINDS: dict[str, Change] = {
    "1 MiB of noise": _overwrite(lambda rng, count: rng.randbytes(count)),
    "1 MiB of zeros": _overwrite(lambda _, count: bytes(count)),
    "a byte missing": _remove(1),
    "64 KiB missing": _remove(2**16),
    "a byte too many": _insert_byte,
    "64 KiB twice": _double,
    "a length wrong": _wrong_length,
    "a kind wrong": _wrong_kind,
    "10 bits flipped": _flip_bits,
    "places changed": _swap,
    "content changed": _change_inside,
    "end missing": _cut,
}


def _with_broken_index(whole: Whole) -> bytes:
    data = bytearray(whole.data)
    data[(whole.data_end + len(data)) // 2] ^= 0xFF
    return bytes(data)


INDEXES: dict[str, Callable[[Whole], bytes]] = {
    "index": lambda whole: whole.data,
    "no index": lambda whole: whole.data[: whole.data_end] + _NO_SUMMARY + whole.data[:MAGIC_BYTES],
    "index broken": _with_broken_index,
}


def damaged(whole: Whole, index: str, kind: str, seed: int) -> tuple[bytes, set[int]]:
    """A damaged log, and the frames that it leaves intact."""
    rng = random.Random(f"{index} {kind} {seed}")
    data = bytearray(INDEXES[index](whole))
    hit = KINDS[kind](rng, whole, data)
    return bytes(data), whole.intact(hit)


@dataclass(frozen=True)
class Trial:
    """What a reading gave of the frames that were due. `silent`: frames were lost without a word."""

    due: int
    found: int
    silent: bool


def trial(whole: Whole, index: str, kind: str, seed: int, path: Path) -> Trial:
    """Damage a log, write it to `path`, and read it."""
    data, due = damaged(whole, index, kind, seed)
    path.write_bytes(data)
    damage = Damage()
    exact = whole.checksummed and kind != "content changed"
    found = set(_frames(path, whole, damage, exact))
    return Trial(len(due), len(due & found), exact and len(found) < len(whole.frames) and damage.complete)


def _frames(path: Path, whole: Whole, damage: Damage, exact: bool) -> Iterator[int]:
    """The log times of the frames of which both images are read as they were recorded; `exact`: no other is read."""
    sides: dict[int, set[str]] = {}
    for message in LogFile(path).messages(damage, whole.topics):
        same = whole.checksums.get((message.channel.topic, message.log_time_ns)) == zlib.crc32(message.data)
        assert same or not exact
        if same:
            sides.setdefault(message.log_time_ns, set()).add(message.channel.topic)
    return (stamp for stamp, topics in sides.items() if topics == whole.topics)
