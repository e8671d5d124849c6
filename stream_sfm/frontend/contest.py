"""Whether another motion contests the one that is followed, remembered for a while.

Two sets of tracks move differently, and nothing tells which of them stands still. When one of them leaves the view,
that does not say that the other one was the background: the doubt lasts as long again as it has lasted, and half a
second at least.
"""

from dataclasses import replace

from ..geometry import se3
from ..geometry.resection import Resection, SecondMotion
from ..geometry.se3 import Array

# Half a second of most cameras; by then a background has got new tracks in other places, and a body may show itself.
_MEMORY_FRAMES = 10


class Contest:
    """Takes the motion of every frame, and says which other one may be right as well."""

    def __init__(self) -> None:
        self._rival: SecondMotion | None = None
        self._other_from_first: Array | None = None
        self._frames_seen = 0  # frames with a rival since the last one without doubt
        self._frames_left = 0

    def judge(self, motion: Resection) -> SecondMotion | None:
        """Return the rival of a frame's motion: its own, or one that differs from it as the last one did."""
        if motion.rival is not None:
            self._frames_seen += 1
            self._rival, self._frames_left = motion.rival, max(_MEMORY_FRAMES, self._frames_seen)
            self._other_from_first = motion.rival.cam_from_ref @ se3.inverse(motion.cam_from_ref)
            return motion.rival
        if self._rival is None or self._other_from_first is None or self._frames_left == 0:
            self._frames_seen = 0
            return None
        self._frames_left -= 1
        return replace(self._rival, cam_from_ref=self._other_from_first @ motion.cam_from_ref)
