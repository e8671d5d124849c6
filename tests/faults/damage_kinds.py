"""Ten kinds of damage to a chunked log, in three states of its index, and the frames that each leaves intact."""

import io
import random
import struct
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from stream_sfm.mcap_file.damage import Damage
from stream_sfm.mcap_file.log_file import LogFile
from stream_sfm.recording.stereo_log import open_log

_HEAD = struct.Struct("<BQ")  # kind, length of the body in bytes
_MAGIC_BYTES = 8
_NO_SUMMARY = _HEAD.pack(Opcode.DATA_END, 4) + bytes(4) + _HEAD.pack(Opcode.FOOTER, 20) + bytes(20)

Span = tuple[int, int]  # bytes [start, end) of a file
# Changes the data in place, and returns what it has hit of the undamaged file; an empty span lies between two bytes.
Change = Callable[[random.Random, "Whole", bytearray], list[Span]]


@dataclass(frozen=True)
class Whole:
    """An undamaged log. `chunks`: their bytes; `frames`: log time of a frame -> the chunks that its images are in.

    `checksums`: of the messages with images, by topic and log time.
    """

    data: bytes
    topics: frozenset[str]
    chunks: list[Span]
    frames: dict[int, set[Span]]
    checksums: dict[tuple[str, int], int]
    data_end: int  # offset of the record behind the last message

    def intact(self, hit: list[Span]) -> set[int]:
        """The frames whose chunks are not hit."""
        bad = {(a, b) for a, b in self.chunks if any(a < end and start < b for start, end in hit)}
        return {frame for frame, chunks in self.frames.items() if not chunks & bad}


def whole_log(path: Path) -> Whole:
    """Read the layout of an undamaged log, by mcap's own reader."""
    data = path.read_bytes()
    log = open_log(path)
    topics = frozenset((log.left_topic, log.right_topic))
    stream, cameras, chunks = io.BytesIO(data), dict[int, str](), list[Span]()
    sides: dict[int, list[Span]] = {}
    checksums: dict[tuple[str, int], int] = {}
    data_end, at = len(data), _MAGIC_BYTES
    for record in StreamReader(stream, emit_chunks=True).records:
        span = at, stream.tell()
        at = span[1]
        if isinstance(record, Chunk):
            chunks.append(span)
            for inner in breakup_chunk(record):
                if isinstance(inner, Channel) and inner.topic in topics:
                    cameras[inner.id] = inner.topic
                elif isinstance(inner, Message) and inner.channel_id in cameras:
                    sides.setdefault(inner.log_time, []).append(span)
                    checksums[cameras[inner.channel_id], inner.log_time] = zlib.crc32(inner.data)
        elif record.__class__.__name__ == "DataEnd":
            data_end = span[0]
    frames = {stamp: set(both) for stamp, both in sides.items() if len(both) == len(topics)}
    assert chunks and frames, f"{path} has no chunks, or no frames of two images at one time"
    return Whole(data, topics, chunks, frames, checksums, data_end)


def _somewhere(rng: random.Random, whole: Whole, count: int) -> int:
    """Where `count` bytes of the data section begin."""
    return rng.randrange(_MAGIC_BYTES, max(whole.data_end - count, _MAGIC_BYTES + 1))


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
    at = rng.choice(whole.chunks)[0] + 1
    length = int.from_bytes(data[at : at + 8], "little")
    wrong = rng.choice([0, 7, length - 1, length + 1, length // 2, 3 * length, 2**40, 2**64 - 1])
    data[at : at + 8] = (wrong % 2**64).to_bytes(8, "little")
    return []  # it is given a second time inside the chunk


def _wrong_kind(rng: random.Random, whole: Whole, data: bytearray) -> list[Span]:
    data[rng.choice(whole.chunks)[0]] = rng.choice([1, 2, 5, 7, 9, 12, 15, 16, 127, 128, 255])
    return []  # the content of the chunk shows that it is one


def _flip_bits(rng: random.Random, whole: Whole, data: bytearray) -> list[Span]:
    places = [_somewhere(rng, whole, 1) for _ in range(10)]
    for at in places:
        data[at] ^= 1 << rng.randrange(8)
    return [(at, at + 1) for at in places]


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
    "length of a chunk wrong": _wrong_length,
    "kind of a chunk wrong": _wrong_kind,
    "10 bits flipped": _flip_bits,
    "end missing": _cut,
}


def _without_index(whole: Whole) -> bytes:
    return whole.data[: whole.data_end] + _NO_SUMMARY + whole.data[:_MAGIC_BYTES]


def _with_broken_index(whole: Whole) -> bytes:
    data = bytearray(whole.data)
    data[(whole.data_end + len(data)) // 2] ^= 0xFF
    return bytes(data)


INDEXES: dict[str, Callable[[Whole], bytes]] = {
    "index": lambda whole: whole.data,
    "no index": _without_index,
    "index broken": _with_broken_index,
}


@dataclass(frozen=True)
class Trial:
    """What a reading gave of the frames that were due. `silent`: frames were lost without a word."""

    due: int
    found: int
    silent: bool
    seconds: float


def trial(whole: Whole, index: str, kind: str, seed: int, path: Path) -> Trial:
    """Damage a log, write it to `path`, and read it."""
    rng = random.Random(f"{index} {kind} {seed}")
    data = bytearray(INDEXES[index](whole))
    hit = KINDS[kind](rng, whole, data)
    path.write_bytes(data)
    due = whole.intact(hit)
    start = time.perf_counter()
    damage = Damage()
    found = set(_frames(path, whole, damage))
    seconds = time.perf_counter() - start
    return Trial(len(due), len(due & found), len(found) < len(whole.frames) and damage.complete, seconds)


def _frames(path: Path, whole: Whole, damage: Damage) -> Iterator[int]:
    """The log times of the frames of which both images are read, as they were recorded."""
    sides: dict[int, set[str]] = {}
    for message in LogFile(path).messages(damage, whole.topics):
        assert whole.checksums[message.channel.topic, message.log_time_ns] == zlib.crc32(message.data)
        sides.setdefault(message.log_time_ns, set()).add(message.channel.topic)
    return (stamp for stamp, topics in sides.items() if topics == whole.topics)
