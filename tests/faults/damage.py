"""Damage to logs of every layout, in three states of their index, and the frames that stay intact.

The oracle knows nothing of our reader: the layout is read off the *undamaged* file by mcap's own `StreamReader`, and a
frame is intact where nothing was done to the chunks, or else the messages, that hold its images.
"""

import io
import random
import struct
import zlib
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk, get_chunk_data_stream

from stream_sfm.logs.mcap_file.log_file import LogFile
from stream_sfm.logs.mcap_file.message import Damage
from stream_sfm.logs.recording.stereo_log import open_log
from tests.faults.records import HEAD, MAGIC_BYTES, record

Span = tuple[int, int]  # bytes [start, end) of a file
Edit = tuple[int, int, bytes]  # bytes [start, end) of the undamaged file, and what takes their place


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
        """The frames whose pieces are not hit; an empty span hits the piece that it lies in."""
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
    sides = defaultdict[int, list[Span]](list)
    checksums, summed, at = dict[tuple[str, int], int](), True, MAGIC_BYTES
    for found in StreamReader(stream, emit_chunks=True).records:
        span = at, stream.tell()
        at = span[1]
        if isinstance(found, Chunk | Message):
            pieces.append(span)
            summed &= isinstance(found, Chunk) and found.uncompressed_crc != 0
        for inner in breakup_chunk(found) if isinstance(found, Chunk) else [found]:
            if isinstance(inner, Channel) and inner.topic in topics:
                cameras[inner.id] = inner.topic
            elif isinstance(inner, Message) and inner.channel_id in cameras:
                sides[inner.log_time].append(span)
                checksums[cameras[inner.channel_id], inner.log_time] = zlib.crc32(inner.data)
    frames = {stamp: set(both) for stamp, both in sides.items() if len(both) == len(topics)}
    assert frames, f"{path} has no frames of two images at one time"
    return Whole(data, topics, records, pieces, frames, checksums, summed)


def _somewhere(rng: random.Random, whole: Whole, most: int) -> Span:
    """At most so many bytes of the data section."""
    count = min(most, max(len(whole.data) // 10, 1))
    at = rng.randrange(MAGIC_BYTES, max(whole.data_end - count, MAGIC_BYTES + 1))
    return at, at + count


def _become(
    most: int, content: Callable[[random.Random, bytes], bytes], stay: bool = False
) -> Callable[[random.Random, Whole], list[Edit]]:
    """At most so many bytes somewhere are replaced by what becomes of them; or they `stay`, and that follows them."""

    def edits(rng: random.Random, whole: Whole) -> list[Edit]:
        start, end = _somewhere(rng, whole, most)
        return [(end if stay else start, end, content(rng, whole.data[start:end]))]

    return edits


def _wrong_length(rng: random.Random, whole: Whole) -> list[Edit]:
    start, end = rng.choice(whole.pieces)
    length = end - start - HEAD.size
    wrong = rng.choice([0, 7, length - 1, length + 1, length // 2, 3 * length, 2**40, 2**64 - 1])
    return [(start + 1, start + 9, (wrong % 2**64).to_bytes(8, "little"))]


def _wrong_kind(rng: random.Random, whole: Whole) -> list[Edit]:
    start, _ = rng.choice(whole.pieces)
    return [(start, start + 1, bytes([rng.choice([1, 2, 7, 9, 12, 15, 16, 127, 128, 255])]))]


def _flipped_bits(rng: random.Random, whole: Whole) -> list[Edit]:
    places = {_somewhere(rng, whole, 1)[0] for _ in range(10)}
    return [(at, at + 1, bytes([whole.data[at] ^ 1 << rng.randrange(8)])) for at in places]


def _changed_places(rng: random.Random, whole: Whole) -> list[Edit]:
    """Two pieces change places, or one comes twice."""
    (a, b), (c, d) = sorted(rng.sample(whole.pieces, 2))
    first, second = whole.data[a:b], whole.data[c:d]
    return rng.choice([[(a, b, second), (c, d, first)], [(a, b, first + first)]])


def _changed_inside(rng: random.Random, whole: Whole) -> list[Edit]:
    """Bytes inside a piece change, in a chunk its checksum with them: hostile, not damaged."""
    start, end = rng.choice(whole.pieces)
    kind, body = whole.data[start], whole.data[start + HEAD.size : end]
    chunk = Chunk.read(ReadDataStream(io.BytesIO(body))) if kind == Opcode.CHUNK else None
    if chunk is not None:
        stream, size = get_chunk_data_stream(chunk)
        body = stream.read(size)
    at, length = rng.randrange(len(body)), rng.choice((1, 4, 50))
    changed = rng.choice((rng.randbytes(length), bytes(length), b"", body[at : at + length] * 2))
    body = body[:at] + changed + body[at + length :]
    if chunk is not None:
        packed = zstandard.compress(body)
        times = chunk.message_start_time, chunk.message_end_time
        head = struct.pack("<QQQII4sQ", *times, len(body), zlib.crc32(body), 4, b"zstd", len(packed))
        body = head + packed
    return [(start, end, record(kind, body))]


KINDS: dict[str, Callable[[random.Random, Whole], list[Edit]]] = {
    "1 MiB of noise": _become(2**20, lambda rng, old: rng.randbytes(len(old))),
    "1 MiB of zeros": _become(2**20, lambda _, old: bytes(len(old))), "a byte missing": _become(1, lambda *_: b""),
    "64 KiB missing": _become(2**16, lambda *_: b""),
    "a byte too many": _become(1, lambda rng, _: rng.randbytes(1), stay=True),
    "64 KiB twice": _become(2**16, lambda _, old: old, stay=True), "a length wrong": _wrong_length,
    "a kind wrong": _wrong_kind, "10 bits flipped": _flipped_bits, "places changed": _changed_places,
    "content changed": _changed_inside,
    "end missing": lambda rng, whole: [(_somewhere(rng, whole, 1)[0], len(whole.data), b"")],
}  # fmt: skip


def _without_index(whole: Whole) -> bytes:
    end = record(Opcode.DATA_END, bytes(4)) + record(Opcode.FOOTER, bytes(20)) + whole.data[:MAGIC_BYTES]
    return whole.data[: whole.data_end] + end


def _with_broken_index(whole: Whole) -> bytes:
    data = bytearray(whole.data)
    data[(whole.data_end + len(data)) // 2] ^= 0xFF
    return bytes(data)


INDEXES: dict[str, Callable[[Whole], bytes]] = {
    "index": lambda whole: whole.data,
    "no index": _without_index,
    "index broken": _with_broken_index,
}


def damaged(whole: Whole, index: str, kind: str, seed: int) -> tuple[bytes, set[int]]:
    """A damaged log, and the frames that it leaves intact."""
    data, edits = INDEXES[index](whole), KINDS[kind](random.Random(f"{index} {kind} {seed}"), whole)
    for start, end, changed in sorted(edits, reverse=True):
        data = data[:start] + changed + data[end:]
    hit = [(start, end) for start, end, _ in edits]
    if kind in ("a length wrong", "a kind wrong") and whole.of_kind(Opcode.CHUNK):
        hit = []  # the length is given a second time inside a chunk, and its content shows that it is one
    return data, whole.intact(hit)


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
    damage, exact = Damage(), whole.checksummed and kind != "content changed"
    sides = defaultdict[int, set[str]](set)  # of the images that are read as they were recorded
    for message in LogFile(path).messages(damage, whole.topics):
        same = whole.checksums.get((message.channel.topic, message.log_time_ns)) == zlib.crc32(message.data)
        assert same or not exact  # then no other is read
        if same:
            sides[message.log_time_ns].add(message.channel.topic)
    found = {stamp for stamp, topics in sides.items() if topics == whole.topics}
    return Trial(len(due), len(due & found), exact and len(found) < len(whole.frames) and damage.complete)
