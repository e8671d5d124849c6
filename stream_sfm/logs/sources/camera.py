"""A camera as a recording that grows while it is read: messages of the log profile, as they would be recorded.

Live estimates are therefore made exactly as in a replay, and the recording made meanwhile replays to the same bytes.
"""

import threading
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...camera.pixels import to_grey
from ...camera.rig import StereoRig
from ...errors import LogError, StreamSfmError
from ..mcap_file.log_writer import MessageWriter
from ..mcap_file.message import Contents, Damage, Message, Source
from .devices import WAIT_S, Device
from .profile import ProfileEncoder

# Pairs of images that wait; older ones are dropped, because a late estimate is useless in live use. With four, the 99 %
# latency was 9 processing times where the machine was busy now and then, and 5 with one; as many pairs were estimated.
WAITING_PAIRS = 1

_REMEMBERED = 64  # pairs whose arrival is known: more than those that wait or are processed ahead


class CameraSource(Source):
    """The images of an open device from the moment of reading; each reading continues where the last one ended.

    `recorder`, if there is one, gets every image that the camera delivers. Images that arrive faster than they are
    taken are dropped, and the damage of a reading says so.
    """

    in_order = True  # left, then right, with ascending stamps: nothing has to be held back for sorting
    format = "live camera"

    def __init__(self, name: str, device: Device, rig: StereoRig, recorder: MessageWriter | None = None) -> None:
        self.path, self.size_bytes = Path(name), 0
        self._device, self._rig, self._recorder = device, rig, recorder
        self._grabber: _Grabber | None = None

    def contents(self) -> Contents | None:
        """Return the topics; the number of messages is not known in advance."""
        encoder = ProfileEncoder(self._rig)
        return Contents([(channel, None) for channel in (*encoder.raw_images, *encoder.calibrations)])

    def messages(self, damage: Damage, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield the messages of `topics` (None: all) as the camera delivers them."""
        encoder = ProfileEncoder(self._rig)
        if topics is not None and not topics >= {channel.topic for channel in encoder.raw_images}:
            for side in (0, 1):  # the calibration is known before the first image
                yield from (m for m in encoder.due_calibration(side, 0) if m.channel.topic in topics)
            return
        self._grabber = grabber = _Grabber(self._device, encoder, self._recorder)
        try:
            while (messages := grabber.next()) is not None:
                yield from (m for m in messages if topics is None or m.channel.topic in topics)
        finally:
            grabber.stop()
            self.left_out = grabber.left_out
            if grabber.left_out:
                why = "the camera was faster than the estimates; a recording has them"
                damage.note(f"{grabber.left_out} pairs of images were left out, because {why}")
            if grabber.error is not None:
                damage.add(f"{self.path}: {grabber.error}")

    def waiting(self) -> int | None:
        """Return the number of pairs that wait to be read."""
        return 0 if self._grabber is None else self._grabber.waiting

    def age_s(self, stamp_ns: int) -> float | None:
        """Return the seconds since the pair of this stamp arrived; None if it is not one of the last ones."""
        came_s = None if self._grabber is None else self._grabber.came_s.get(stamp_ns)
        return None if came_s is None else time.monotonic() - came_s

    def close(self) -> None:
        """Release the camera, and finish its recording."""
        try:
            self._device.close()
        finally:
            if self._recorder is not None:
                self._recorder.close()


class _Grabber:
    """A thread that takes and records every image as it arrives, and keeps the newest ones for the reader."""

    def __init__(self, device: Device, encoder: ProfileEncoder, recorder: MessageWriter | None) -> None:
        self._device, self._encoder, self._recorder = device, encoder, recorder
        self._waiting: deque[list[Message]] = deque()
        self._news, self._ended, self._stopped = threading.Condition(), False, False
        self._last_ns: int | None = None
        self.left_out = 0
        self.came_s: dict[int, float] = {}  # of the last pairs, by their stamps
        self.error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Number of pairs that wait to be read."""
        return len(self._waiting)

    def next(self) -> list[Message] | None:
        """Return the next pair, waiting for it; None after the last one. Raises the errors of the recorder."""
        with self._news:
            self._news.wait_for(lambda: self._waiting or self._ended)
            if self._waiting:
                return self._waiting.popleft()
        if isinstance(self.error, StreamSfmError) and not isinstance(self.error, LogError):
            raise self.error  # a full disk, not the end of the camera
        return None

    def stop(self) -> None:
        """Stop after the current image."""
        self._stopped = True
        self._thread.join(WAIT_S + 1)

    def _run(self) -> None:
        try:
            while not self._stopped and (taken := self._device.grab()) is not None:
                self._take(*taken)
        except Exception as error:  # the manufacturer's package may raise any kind
            self.error = error
        with self._news:
            self._ended = True
            self._news.notify()

    def _take(self, stamp_ns: int, *images: np.ndarray) -> None:
        if self._stopped or (self._last_ns is not None and stamp_ns <= self._last_ns):
            return  # the camera answered after the recording was finished, or with the same image again
        self._last_ns = stamp_ns
        self.came_s = dict([*self.came_s.items(), (stamp_ns, time.monotonic())][-_REMEMBERED:])
        messages: list[Message] = []
        for side, image in enumerate(images):
            messages += self._encoder.due_calibration(side, stamp_ns)
            messages.append(self._encoder.raw_image(side, stamp_ns, to_grey(image)))
        if self._recorder is not None:
            for message in messages:
                self._recorder.write(message)
        with self._news:
            self._waiting.append(messages)
            if len(self._waiting) > WAITING_PAIRS:
                dropped = self._waiting.popleft()
                self._waiting[0][:0] = [m for m in dropped if m.channel in self._encoder.calibrations]
                self.left_out += 1
            self._news.notify()
