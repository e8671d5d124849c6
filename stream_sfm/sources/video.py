"""Videos that OpenCV decodes: their frames in grey with their times, and one as a recording with one image topic."""

import os
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ..camera.pixels import to_grey
from ..errors import InputError
from ..mcap_file.damage import Damage
from .profile import ProfileEncoder
from .source import Contents, Message, Source

Grey = NDArray[np.uint8]


class Video:
    """One file: its size, and its frames with their times."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        capture = self._open()
        self.width = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH))
        self.height = int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        self.rate_hz = float(capture.get(cv2.CAP_PROP_FPS))
        self.expected = int(max(capture.get(cv2.CAP_PROP_FRAME_COUNT), 0))
        self.read = 0
        capture.release()

    def _open(self) -> cv2.VideoCapture:
        if not self.path.is_file():
            raise InputError(f"cannot read {self.path}: the file does not exist")
        capture = cv2.VideoCapture(os.fspath(self.path))
        if not capture.isOpened():
            raise InputError(
                f"{self.path} is not a video that OpenCV can decode: convert it, for example with "
                "`ffmpeg -i IN -c:v ffv1 OUT.mkv`"
            )
        return capture

    def frames(self, rate_hz: float | None) -> Iterator[tuple[int, Grey]]:
        """Yield stamps and grey frames. Raises InputError where times do not grow and no rate is given."""
        capture, last_ns = self._open(), -1
        try:
            while capture.grab():
                stamp_ns = round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
                if rate_hz is not None:
                    stamp_ns = round(self.read * 1e9 / rate_hz)
                elif stamp_ns <= last_ns:
                    raise InputError(
                        f"{self.path}: the times of frames {self.read - 1} and {self.read} do not grow: give the rate, "
                        f"which may be {self.rate_hz:g} frames per second",
                        hint=("rate_hz",),
                    )
                done, picture = capture.retrieve()
                if not done:
                    break
                self.read, last_ns = self.read + 1, stamp_ns
                yield stamp_ns, np.asarray(to_grey(picture), np.uint8)
        finally:
            capture.release()

    def check_complete(self) -> None:
        """Note frames that the container announces and that could not be decoded. Raises InputError without any."""
        if not self.read:
            raise InputError(f"{self.path}: not one frame could be decoded")
        if self.read < self.expected - 1:  # some containers count one too many
            self.notes.append(f"{self.path}: {self.read} of {self.expected} frames could be decoded")


class VideoSource(Source):
    """A video as a recording: its frames are raw images on one topic, whether they hold one side or both."""

    format = "video"
    in_order = True

    def __init__(self, path: Path) -> None:
        self.path, self.size_bytes = path, path.stat().st_size
        self._video = Video(path)

    def contents(self) -> Contents | None:
        """The topic, and how many frames the container announces."""
        return Contents([(ProfileEncoder(None).both_images, self._video.expected or None)])

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the frames, if their topic is among `topics`; what ends them early is added to `damage`."""
        encoder, video = ProfileEncoder(None), Video(self.path)
        if topics is not None and encoder.both_images.topic not in topics:
            return
        try:
            for stamp_ns, image in video.frames(None):
                yield encoder.raw_image(None, stamp_ns, image)
            video.check_complete()
        except InputError as error:
            damage.add(str(error))
        for note in video.notes:
            damage.add(note)
