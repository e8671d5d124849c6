"""Remembers for some frames a second motion that may be the camera's.

Two sets of tracks move differently, and nothing shows which of them is static. If one of them leaves the view, this
does not prove that the other one is the background. So the ambiguity continues for as long again as it has lasted, and
at least until tracks that have begun in the meantime have a full history. A frame is not ambiguous if both sets are in
view and one motion explains them, whichever of them is the background. If the scene is repetitive (`repetition.py`),
the ambiguity lasts until something unique comes into view.
"""

from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from ... import core
from ...config.rules import MotionRules
from ...geometry import Array, se3
from ...geometry.resection import MANY_VIEWS, MIN_VIEWS, Resection, SecondMotion
from ...record import changed, record
from ..tracks import Tracks


@record
class AmbiguityMemory:
    """The `last` second motion, and its difference from the motion followed, `second_from_first` (4, 4).

    `frames_seen`: frames with a second motion since the last one without ambiguity; `frames_left`: for how many more
    frames the ambiguity lasts. `repeats`: it exists because the scene looks the same under both motions. `is_new`: none
    of its tracks were followed before. `ids` (m,): its tracks.
    """

    last: SecondMotion | None = None
    second_from_first: Array | None = None
    frames_seen: int = 0
    frames_left: int = 0
    repeats: bool = False
    is_new: bool = False
    ids: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    rules: MotionRules = MotionRules()

    def after(
        self, motion: Resection, before: Tracks, alike: SecondMotion | None = None
    ) -> tuple["AmbiguityMemory", SecondMotion | None, bool]:
        """Return the memory after a frame's motion, and the second motion that may be the camera's.

        The second motion is the frame's own, or one for which the scene looks `alike`, or one that differs from the
        frame's motion as the last one did. `before` (n): the tracks of its views. Also returns whether an ambiguity was
        resolved in favour of the motion followed: the view is no longer repetitive, or the second set proves to be a
        body in front of the scene, or enough of the former background still agrees and none of it was in the second
        set.
        """
        second, old = motion.ambiguous or alike, before.agreed >= self.rules.full_history
        if second is not None:
            apart, seen = second.cam_from_ref @ se3.inverse(motion.cam_from_ref), self.frames_seen + 1
            new = alike is not None or old[second.views].sum() < MIN_VIEWS
            new = bool(new and not second.lasted and (self.is_new or self.frames_left == 0))
            lasts = int(self.rules.ambiguity_lasts * max(self.rules.full_history, seen))
            ids = self.ids if motion.ambiguous is None else before.ids[second.views]
            memory = AmbiguityMemory(second, apart, seen, lasts, alike is not None, new, ids, self.rules)
            return memory, second, False
        remembered = self.second_beside(motion.cam_from_ref)
        if remembered is None or self.repeats:
            return AmbiguityMemory(rules=self.rules), None, self.repeats
        if self.frames_left == 1 and self.is_new and (motion.accepted & old).sum() >= MANY_VIEWS:
            return AmbiguityMemory(rules=self.rules), None, True
        if self._is_of_body(motion, before):
            return AmbiguityMemory(rules=self.rules), None, True
        memory = changed(self, frames_left=self.frames_left - 1)
        return memory, None if self._is_explained(motion, before) else remembered, False

    def _is_of_body(self, motion: Resection, before: Tracks) -> bool:
        """Whether the second set is still in view, and lies in front of the points of the motion."""
        second = motion.second
        if second is None or not second.in_front:
            return False
        return bool(np.count_nonzero(core.among(before.ids[second.views], self.ids)) >= MIN_VIEWS)

    def _is_explained(self, motion: Resection, before: Tracks) -> bool:
        """Whether the second set is still in view, and nearly all of it agrees with the motion."""
        its = core.among(before.ids, self.ids)
        n_agree = np.count_nonzero(its & motion.accepted)
        return bool(n_agree >= MANY_VIEWS and n_agree >= self.rules.as_many * np.count_nonzero(its))

    def second_beside(self, cam_from_ref: Array) -> SecondMotion | None:
        """Predict the alternative motion: a given one (4, 4) composed with the last difference."""
        if self.last is None or self.second_from_first is None or self.frames_left == 0:
            return None
        return changed(self.last, cam_from_ref=self.second_from_first @ cam_from_ref)
