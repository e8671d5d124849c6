"""Which other motion may as well be the camera's, remembered for a while.

Two sets of tracks move differently, and nothing tells which of them stands still. When one of them leaves the view,
that does not say that the other one was the background: the ambiguity lasts as long again as it has lasted, and until
tracks that have begun meanwhile have a full history at least.
"""

from dataclasses import dataclass, replace

from ..geometry import se3
from ..geometry.resection import Resection, SecondMotion
from ..geometry.se3 import Array
from .tracks import FULL_HISTORY


@dataclass(frozen=True, slots=True)
class AmbiguityMemory:
    """The last other motion, and by what it differed from the one that was followed, `other_from_first` (4, 4).

    `frames_seen`: frames with another motion since the last one without ambiguity; `frames_left`: how long it lasts.
    """

    last: SecondMotion | None = None
    other_from_first: Array | None = None
    frames_seen: int = 0
    frames_left: int = 0

    def after(self, motion: Resection) -> tuple["AmbiguityMemory", SecondMotion | None]:
        """Return the memory after a frame's motion, and the other one that may be right as well.

        That is the frame's own, or one that differs from the frame's motion as the last one did.
        """
        other = motion.ambiguous
        if other is not None:
            seen = self.frames_seen + 1
            apart = other.cam_from_ref @ se3.inverse(motion.cam_from_ref)
            return AmbiguityMemory(other, apart, seen, max(FULL_HISTORY, seen)), other
        if self.last is None or self.other_from_first is None or self.frames_left == 0:
            return replace(self, frames_seen=0), None
        remembered = replace(self.last, cam_from_ref=self.other_from_first @ motion.cam_from_ref)
        return replace(self, frames_left=self.frames_left - 1), remembered
