"""H.264 and H.265 as cameras send it, one frame per message, decoded to grey images by the FFmpeg in OpenCV.

OpenCV reads files, so it gets the frames as a Matroska file that is made while it is read. The time of a frame in this
file is its number, which shows to which message a decoded image belongs, whatever was lost on the way.
"""

import io
import os
import re
from collections import deque
from collections.abc import Iterator
from itertools import islice
from typing import Any, Generic, TypeVar

import cv2

from ...camera.models import MAX_PIXELS
from ...camera.pixels import Grey, to_grey
from ...errors import LogError
from .video_references import FrameNumbers, units

T = TypeVar("T")

_CODECS = {"h264": b"V_MPEG4/ISO/AVC", "h265": b"V_MPEGH/ISO/HEVC"}  # their names in Matroska
# Names in messages: their own, or those of FFmpeg's encoders, such as hevc_nvenc
_NAMES = {"h264": re.compile(r"h\.?264|x264|avc", re.I), "h265": re.compile(r"h\.?265|x265|hevc", re.I)}
_UNITS_LOOKED_AT = 16  # parameter sets come first, after a delimiter and messages
_DELAYED_FRAMES = 64  # more than a decoder holds back: later frames are lost
_MOST_WAITING = 4096  # FFmpeg reads 32 KiB at a time, which may be many frames of a static scene
_UNKNOWN_SIZE = 0x01FFFFFFFFFFFFFF


def codec_of(name: str) -> str | None:
    """Return h264 or h265 for the format name in a message; None for anything else."""
    return next((codec for codec, names in _NAMES.items() if names.search(name)), None)


def quiet_ffmpeg() -> None:
    """Keep FFmpeg from printing unless the user has asked for it; call this before OpenCV first uses it."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


def starts_a_picture_group(codec: str, data: bytes) -> bool:
    """Whether a decoder can start at this frame, because it comes with the parameters of the stream."""
    heads = (unit[0] for unit in islice(units(data), _UNITS_LOOKED_AT))
    return any((head & 0x1F == 7) if codec == "h264" else (head >> 1 & 0x3F == 33) for head in heads)


class VideoStream(Generic[T]):
    """The images of one stream: iterate `pictures`. `frames` yields data about each frame, and its bytes.

    `skipped`: frames before the first key frame; `lost`: later frames without an image; `incomplete`: frames that refer
    to missing ones, which the decoder does not get. It may still make an image of a damaged frame, from earlier ones.
    """

    def __init__(self, codec: str, frames: Iterator[tuple[T, bytes]]) -> None:
        """Raises LogError if OpenCV has no FFmpeg that reads from a stream."""
        quiet_ffmpeg()
        if cv2.CAP_FFMPEG not in cv2.videoio_registry.getStreamBufferedBackends():
            raise LogError("this OpenCV cannot decode video in a log: install opencv-python-headless")
        self._codec, self._frames, self._numbers = codec, frames, FrameNumbers()
        self.skipped = self.lost = self.incomplete = 0
        self._waiting: dict[int, tuple[T, bytes]] = {}  # number -> a frame that is not decoded yet
        self._again: deque[tuple[T, bytes]] = deque()  # frames that a decoder had read when it gave up
        self._fed, self._newest, self._begun, self._ended = 0, -1, False, False

    def pictures(self) -> Iterator[tuple[T, Grey]]:
        """Yield the frames that can be decoded with their images (h, w), some frames later than they are read."""
        while not self._ended or self._again:
            self._fed, self._newest = 0, -1
            yield from self._decoded()
            left = [frame for number, frame in sorted(self._waiting.items()) if number > self._newest]
            # If a decoder gives up, another one starts at the next group of pictures.
            self._again = deque([*left[1:], *self._again])
            self.lost += len(self._waiting) - len(left[1:])
            self._waiting.clear()
            self._ended |= self._fed == 0

    def _decoded(self) -> Iterator[tuple[T, Grey]]:
        """Yield the images that one decoder makes until it gives up."""
        pipe = _Pipe(self._file())
        make: Any = cv2.VideoCapture  # its stub lacks reading from a stream
        capture = make(pipe, cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
        try:
            width, height = (capture.get(p) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
            while width * height <= MAX_PIXELS and capture.grab():
                done, picture = capture.retrieve()
                of = self._taken(round(capture.get(cv2.CAP_PROP_POS_MSEC)))
                if done and of is not None:
                    yield of, to_grey(picture)
        finally:
            capture.release()
        if pipe.error is not None:
            raise pipe.error

    def _taken(self, number: int) -> T | None:
        """Return the data about the frame of this number, which is decoded; older frames will no longer come."""
        self._newest = max(self._newest, number)
        for old in [n for n in self._waiting if n < number - _DELAYED_FRAMES]:
            del self._waiting[old]
            self.lost += 1
        return self._waiting.pop(number, (None, b""))[0]

    def _file(self) -> Iterator[bytes]:
        """Yield the parts of a Matroska file: its head, then each frame as its own cluster."""
        for of, data in self._next():
            if self._fed == 0:
                if not starts_a_picture_group(self._codec, data):
                    self.skipped += not self._begun
                    self.lost += self._begun
                    continue
                self._begun = True
                yield _head(_CODECS[self._codec])
            block = b"\x81\0\0\x80" + data  # a single frame of track 1, at the time of its cluster
            part = _element(0x1F43B675, _element(0xE7, _number(self._fed)) + _element(0xA3, block))
            if len(self._waiting) == _MOST_WAITING:
                del self._waiting[min(self._waiting)]
                self.lost += 1
            self._waiting[self._fed] = of, data
            self._fed += 1
            yield part
        self._ended = True

    def _next(self) -> Iterator[tuple[T, bytes]]:
        while self._again:
            yield self._again.popleft()
        while (frame := next(self._frames, None)) is not None:  # no `yield from`: it would end with the decoder
            if self._codec != "h264" or self._numbers.are_complete(frame[1]):
                yield frame
            else:
                self.incomplete += 1


class _Pipe(io.BufferedIOBase):
    """Parts as a file that can be read once. An exception in making them ends it, and is kept."""

    def __init__(self, parts: Iterator[bytes]) -> None:
        self._parts, self._left = parts, memoryview(b"")
        self.error: BaseException | None = None

    def read(self, size: int | None = -1) -> bytes:
        """Return at most the rest of one part, so that nothing is read before the decoder needs it."""
        try:
            while not self._left:
                self._left = memoryview(next(self._parts, b""))
                if not self._left:
                    return b""
        except BaseException as error:  # OpenCV, which calls this, would lose it
            self.error = error
            return b""
        end = len(self._left) if size is None or size < 0 else size
        part, self._left = bytes(self._left[:end]), self._left[end:]
        return part

    def seek(self, offset: int, whence: int = 0) -> int:
        """Refuse, by OpenCV's convention."""
        return -1


def _head(codec: bytes) -> bytes:
    """Return all that precedes the first frame: one video track, whose unit of time is a millisecond."""
    ebml = _element(0x1A45DFA3, _element(0x4282, b"matroska") + _element(0x4287, _number(2)))
    size = _element(0xE0, _element(0xB0, _number(16)) + _element(0xBA, _number(16)))  # the real size is in the stream
    numbers = b"".join(_element(key, _number(1)) for key in (0xD7, 0x73C5, 0x83))  # of the track, and its kind
    track = _element(0x1654AE6B, _element(0xAE, numbers + _element(0x86, codec) + size))
    segment = (0x18538067).to_bytes(4, "big") + _UNKNOWN_SIZE.to_bytes(8, "big")
    return ebml + segment + _element(0x1549A966, _element(0x2AD7B1, _number(1_000_000))) + track


def _element(key: int, content: bytes) -> bytes:
    name = key.to_bytes((key.bit_length() + 7) // 8, "big")
    return name + (1 << 56 | len(content)).to_bytes(8, "big") + content


def _number(value: int) -> bytes:
    return value.to_bytes(8, "big")
