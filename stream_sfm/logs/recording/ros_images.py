"""Pairs and decodes live images of two cameras from ROS messages, and never holds many."""

import threading
from collections import deque
from typing import Any

from ...camera.pixels import GreyScaler
from ...camera.rig import StereoRig
from ...errors import FrameError, LogError, as_error
from .frames import RecordedFrame, recorded_frame
from .images import UndecodableImage, check_encoding, decode_grey, image_size
from .messages import ImageMessage, UndecodableMessage, image_of
from .pair_reader import StereoPair
from .pairing import Pairer

_WAITING_PAIRS = 2  # pairs that wait; older ones are dropped, because a late estimate is useless in live use
_SIDES = ("left", "right")


class RosImages:
    """Pairs images of a live stereo camera in the same way as a log: one thread puts messages, another takes
    frames.

    Messages are those of `sensor_msgs/Image` and `CompressedImage`, or anything with their fields, in every encoding
    that a log may have. Stamps ascend. `dropped` counts pairs that waited while newer ones came.
    """

    def __init__(self, rig: StereoRig) -> None:
        self._cameras = tuple(rig.cameras.values())
        self._pairer: Pairer[ImageMessage] = Pairer(in_order=True)
        self._waiting: deque[StereoPair] = deque()
        self._scaler = GreyScaler()
        self._news = threading.Condition()
        self._clears = self._clears_when_taken = 0
        self.dropped = 0

    @property
    def unpaired(self) -> int:
        """The number of images without a partner within half a frame period, or with a stamp that does not increase."""
        counts = self._pairer.counts
        return sum(counts.unpaired) + sum(counts.disordered)

    def put(self, side: int, message: Any) -> None:
        """Take the next message of the left (0) or right (1) camera. Raises FrameError if it cannot be an image."""
        with as_error(FrameError, "", UndecodableMessage, LogError, ValueError, TypeError):
            image = image_of(_SIDES[side], message)
            check_encoding(image, "the camera")
        with self._news:
            for left, right in self._pairer.push(side, image.stamp_ns, image, len(image.data)):
                self._waiting.append(StereoPair(left, right))
            while len(self._waiting) > _WAITING_PAIRS:
                self._waiting.popleft()
                self.dropped += 1
            self._news.notify()

    def take(self, timeout_s: float | None = None) -> RecordedFrame | None:
        """Wait for the next pair, and return it decoded; None after a time without one, and after `clear`.

        Raises FrameError if an image is damaged or does not have the calibrated size; the next one may be intact.
        """
        with self._news:
            clears = self._clears
            self._news.wait_for(lambda: self._waiting or self._clears != clears, timeout_s)
            self._clears_when_taken = self._clears
            if not self._waiting:
                return None
            pair = self._waiting.popleft()
        for message, camera in zip(pair.images, self._cameras, strict=True):
            if (size := image_size(message)) != (camera.width, camera.height):
                is_size = "damaged" if size is None else f"of {size[0]}×{size[1]} pixels"
                calibrated = f"its calibration is for {camera.width}×{camera.height}"
                what = f"the {message.topic} image (stamp {message.stamp_ns} ns)"
                raise FrameError(f"{what} is {is_size}, {calibrated}")
        with as_error(FrameError, "", UndecodableImage):
            return recorded_frame(pair, self._scaler.to_uint8(*map(decode_grey, pair.images)))

    def clear(self) -> None:
        """Drop waiting images, for example after a clock was set back."""
        with self._news:
            self._pairer = Pairer(in_order=True)
            self._waiting.clear()
            self._clears += 1
            self._news.notify()

    @property
    def is_current(self) -> bool:
        """Whether the latest frame came after the last `clear`."""
        return self._clears_when_taken == self._clears
