"""Frames of a log: decoded images with their messages, both sides in parallel and one frame ahead."""

from collections import deque
from collections.abc import Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...camera.models import MANY_PIXELS
from ...camera.pixels import Grey, GreyScaler
from ...camera.rig import MonoRig, StereoRig
from ...errors import LogError
from ...types import StereoFrame
from .images import UndecodableImage, decode_grey, image_size
from .pair_reader import StereoPair


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RecordedFrame(StereoFrame):
    """A StereoFrame with the recorded pair from which it was decoded; with one camera, left and right are the same."""

    recorded: StereoPair = field(kw_only=True)


def recorded_frame(pair: StereoPair, images: list[NDArray[np.uint8]]) -> RecordedFrame:
    """Return the frame of a pair and its decoded images; a viewer gets compressed images as they were recorded."""
    left, right = images[0], images[-1]
    pictures = [m.data if m.compressed else image for m, image in zip(pair.images, (left, right), strict=True)]
    return RecordedFrame(pair.stamp_ns, left, right, (pictures[0], pictures[1]), recorded=pair)


class FrameDecoder:
    """Decodes the images of one reading; pairs that cannot be decoded are skipped.

    The first images decide whether the sizes fit the calibration at all. `ahead`: the next pair is read while one is
    decoded, unless images are very large. `skipped`: number of skipped pairs; `problem`: that of the first one.
    """

    def __init__(self, path: Path, rig: StereoRig | MonoRig, ahead: bool = True) -> None:
        self._path = path
        self._cameras = list(rig.cameras.values())
        self._ahead = ahead and all(camera.width * camera.height <= MANY_PIXELS for camera in self._cameras)
        self._scaler = GreyScaler()
        self._sizes_fit = False
        self.skipped = 0
        self.problem = ""

    def frames(self, pairs: Iterator[StereoPair]) -> Generator[RecordedFrame, None, None]:
        """Yield the frame of each pair. Raises LogError if images have another size than the calibration."""
        with ThreadPoolExecutor(2, thread_name_prefix="decode") as pool:
            pending: deque[tuple[StereoPair, list[Future[Grey]]]] = deque()
            for pair in pairs:
                if self._fits(pair):
                    images = pair.images[: len(self._cameras)]
                    pending.append((pair, [pool.submit(decode_grey, image) for image in images]))
                    if len(pending) > self._ahead and (frame := self._frame(*pending.popleft())) is not None:
                        yield frame
            while pending:
                if (frame := self._frame(*pending.popleft())) is not None:
                    yield frame

    def _fits(self, pair: StereoPair) -> bool:
        """Check before decoding whether both sizes are the calibrated ones, so that no header can demand gigabytes."""
        for message, camera in zip(pair.images, self._cameras, strict=False):
            size = image_size(message)
            if size is None:
                self._skip(f"{message.topic}: the header of an image is damaged")
                return False
            if size != (camera.width, camera.height):
                calibrated = f"the calibration is for {camera.width}×{camera.height}"
                text = f"topic {message.topic}: images are {size[0]}×{size[1]}, {calibrated}"
                if not self._sizes_fit:
                    cure = "give the calibration of these images"
                    raise LogError(f"{self._path}: {text}: {cure}", hint=("calibration",))
                self._skip(text)
                return False
        self._sizes_fit = True
        return True

    def _frame(self, pair: StereoPair, images: list[Future[Grey]]) -> RecordedFrame | None:
        """Return the frame; None if an image cannot be decoded."""
        try:
            return recorded_frame(pair, self._scaler.to_uint8(*[image.result() for image in images]))
        except UndecodableImage as error:
            self._skip(str(error))
            return None

    def _skip(self, problem: str) -> None:
        self.skipped += 1
        self.problem = self.problem or problem
