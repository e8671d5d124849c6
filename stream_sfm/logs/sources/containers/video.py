"""A video that OpenCV decodes, as a recording with one image topic: of one side, or of both in each frame."""

import os
from collections.abc import Iterator
from pathlib import Path

import cv2

from ....camera.pixels import to_grey
from ....camera.rig import StereoRig
from ....errors import LogError
from ...mcap_file.message import Channel, Contents, Damage, Message, Source
from ..profile import ProfileEncoder
from ..video_stream import quiet_ffmpeg
from . import Container


class VideoSource(Source):
    """The frames of one file as grey images, with the times in the file, or by its rate if these do not increase.

    `side`: 0 left, 1 right; None: both, side by side or stacked. `rig`: the calibration that is sent with the images
    of a side. Raises LogError.
    """

    format = "video"
    in_order = True

    def __init__(self, path: Path, side: int | None = None, rig: StereoRig | None = None) -> None:
        self.path, self.size_bytes, self._side = path, path.stat().st_size, side
        capture = self._open()
        if not capture.grab():
            raise self._undecodable()
        self._expected, self._rig = int(max(capture.get(cv2.CAP_PROP_FRAME_COUNT), 0)), rig
        self.size = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        capture.release()
        encoder = ProfileEncoder(None)
        self._channel = encoder.both_images if side is None else encoder.raw_images[side]

    def _open(self) -> cv2.VideoCapture:
        quiet_ffmpeg()
        capture = cv2.VideoCapture(os.fspath(self.path))
        if not capture.isOpened():
            raise self._undecodable()
        return capture

    def _undecodable(self) -> LogError:
        cure = "convert it, for example with `ffmpeg -i IN -c:v ffv1 OUT.mkv`"
        return LogError(f"{self.path} is not a video that OpenCV can decode: {cure}")

    def contents(self) -> Contents:
        """Return the topics, and the number of frames that the container announces."""
        channels: list[tuple[Channel, int | None]] = [(self._channel, self._expected or None)]
        if self._rig is not None and self._side is not None:
            channels.append((ProfileEncoder(self._rig).calibrations[self._side], None))
        return Contents(channels)

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all); the reason for an early end is added to `damage`."""
        if topics is not None and not any(channel.topic in topics for channel, _ in self.contents().channels):
            return
        encoder, capture, read, last_ns = ProfileEncoder(self._rig), self._open(), 0, -1
        try:
            period_ns = round(1e9 / rate_hz) if (rate_hz := capture.get(cv2.CAP_PROP_FPS)) > 0 else 0
            while capture.grab():
                stamp_ns = round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
                done, picture = capture.retrieve()
                if not done:
                    break
                if stamp_ns <= last_ns:
                    damage.note(f"{self.path}: its frame times do not grow: its rate is used, {rate_hz:g} Hz")
                    stamp_ns = last_ns + period_ns
                read, last_ns = read + 1, stamp_ns
                sent = [*(() if self._side is None else encoder.due_calibration(self._side, stamp_ns))]
                image = encoder.raw_image(self._side, stamp_ns, to_grey(picture))
                sent.append(image._replace(channel=self._channel))
                yield from (m for m in sent if topics is None or m.channel.topic in topics)
        finally:
            capture.release()
        if read < max(self._expected - 1, 1):  # some containers count one frame too many
            damage.add(f"{self.path}: {read} of {self._expected} frames could be decoded")


_TRANSPORT = rb"G.{187}G.{187}G"  # packets of MPEG-TS
CONTAINER = Container(VideoSource, rb"(?s)\x1aE\xdf\xa3|.{4}ftyp|.{8}AVI |" + _TRANSPORT)  # Matroska, MP4, AVI
