"""Whether a stream of H.264 contains the frames that a frame refers to, by the headers of its slices.

A decoder makes images without them, too, from whatever older frames it has. Each reference frame has the number of the
one before plus one, so that a lost one leaves a gap (ITU-T H.264, 7.3 and 8.2.5.2). What then follows is incomplete
until a decoder can start again. Where a header cannot be read, nothing is known, and the frame counts as complete.
Streams of H.265 need no such test: the decoder itself leaves such frames out.
"""

from collections.abc import Iterator
from typing import NamedTuple

_START_CODE = b"\0\0\1"  # precedes each unit of a frame
_UNITS = 64  # parameter sets and messages precede the first slice; no stream has so many
_HEADER_BYTES = 1024  # parameter sets with their longest tables, and more than the beginning of a slice
_PROFILES_WITH_FORMATS = frozenset({100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135})
_B_SLICES = 1, 6


def units(data: bytes) -> Iterator[bytes]:
    """Yield the units of a frame from its beginning, without start codes; the last one may be cut."""
    at = data.find(_START_CODE)
    for _ in range(_UNITS):
        if at < 0 or at + 3 >= len(data):
            return
        end = data.find(_START_CODE, at + 3)
        yield data[at + 3 : end if end >= 0 else at + 3 + _HEADER_BYTES]
        at = end


class _UnreadableError(ValueError):
    """A header ends too early, or contains what no encoder writes."""


class _Bits:
    """The bits of a unit behind its first byte, most significant first."""

    def __init__(self, content: bytes) -> None:
        content = content.replace(b"\0\0\3", b"\0\0")  # the 3 keeps start codes out
        self._value, self._left = int.from_bytes(content, "big"), 8 * len(content)

    def take(self, count: int) -> int:
        """Return the next `count` bits as a number."""
        self._left -= count
        if self._left < 0:
            raise _UnreadableError
        return self._value >> self._left & (1 << count) - 1

    def number(self, most: int = 1 << 32) -> int:
        """Return a number of variable length, ue(v)."""
        zeros = 0
        while not self.take(1):
            zeros += 1
        value = (1 << zeros) - 1 + self.take(zeros)
        if value > most:
            raise _UnreadableError
        return value

    def numbers(self, count: int) -> None:
        """Leave out so many numbers of variable length."""
        for _ in range(count):
            self.number()


class _Sequence(NamedTuple):
    """What a slice needs of its sequence: the bits of a frame's number and of a plane, and whether gaps are usual."""

    number_bits: int
    plane_bits: int
    has_gaps: bool


class FrameNumbers:
    """The numbers of the frames of one stream, which are given in the order of sending."""

    def __init__(self) -> None:
        self._sequences: dict[int, _Sequence] = {}
        self._sequence_of: dict[int, int] = {}  # parameters of pictures -> of the sequence
        self._last: int | None = None  # the number of the latest reference frame
        self._complete = self._complete_before = True  # since, and before, a decoder could start

    def are_complete(self, data: bytes) -> bool:
        """Whether no frame that this one depends on is missing."""
        starts = False
        for unit in units(data):
            kind, bits = unit[0] & 0x1F, _Bits(unit[1:])
            try:
                if kind == 7:
                    starts = True
                    self._sequences |= [_sequence(bits)]
                elif kind == 8:
                    self._sequence_of |= [(bits.number(255), bits.number(31))]
                elif kind in (1, 5):
                    return self._follow(bits, starts or kind == 5, is_key=kind == 5, is_reference=unit[0] & 0x60 > 0)
            except (_UnreadableError, KeyError):
                self._last = None
        return self._complete

    def _follow(self, bits: _Bits, starts: bool, is_key: bool, is_reference: bool) -> bool:
        bits.number()
        is_b = bits.number(9) in _B_SLICES
        sequence = self._sequences[self._sequence_of[bits.number(255)]]
        bits.take(sequence.plane_bits)
        number = bits.take(sequence.number_bits)
        if starts:
            self._complete_before, self._complete = is_key or self._complete, True
        elif self._last is not None and not sequence.has_gaps:
            self._complete &= number == (self._last + 1) % (1 << sequence.number_bits)
        if not (starts or is_b):
            self._complete_before = True
        if is_reference:
            self._last = number
        return self._complete and self._complete_before | (not is_b)  # the first B frames refer to what was before


def _sequence(bits: _Bits) -> tuple[int, _Sequence]:
    """Read the key of a sequence and its parameters."""
    profile, plane_bits = bits.take(8), 0
    bits.take(16)  # constraints, level
    key = bits.number(31)
    if profile in _PROFILES_WITH_FORMATS:
        chroma = bits.number(3)
        plane_bits = 2 * bits.take(1) if chroma == 3 else 0
        bits.numbers(2)  # bits of a grey value
        bits.take(1)
        if bits.take(1):
            _skip_scaling_lists(bits, 12 if chroma == 3 else 8)
    number_bits, order = bits.number(12) + 4, bits.number(2)
    if order == 0:
        bits.number()
    elif order == 1:
        bits.take(1)
        bits.numbers(2)
        bits.numbers(bits.number(255))
    bits.number()  # of reference frames
    return key, _Sequence(number_bits, plane_bits, bool(bits.take(1)))


def _skip_scaling_lists(bits: _Bits, count: int) -> None:
    for n in range(count):
        last = following = 8
        for _ in range((16 if n < 6 else 64) * bits.take(1)):
            if following:
                value = bits.number()
                following = (last + (value + 1) // 2 * (1 if value % 2 else -1)) % 256
            last = following or last
