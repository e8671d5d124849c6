"""Remembers a second motion that may be the camera's, until something shows which of the two is.

Two sets of tracks move differently, and nothing shows which of them is static. If one of them leaves the view, this
does not prove that the other one is the background. So the ambiguity continues until points that begin in the meantime
confirm the motion followed (`confirmation.py`). A frame is not ambiguous if both sets are in view and one motion
explains them, whichever of them is the background. If the scene is repetitive (`repetition.py`), a frame is ambiguous
until something unique comes into view, and points that begin then confirm or refute the motion.
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
from .confirmation import Confirmation


@record
class AmbiguityMemory:
    """The `last` second motion, and its difference from the motion followed, `second_from_first` (4, 4).

    `confirmation`: of the motion followed, since the last frame with a second motion. `repeats`: the ambiguity exists
    because the scene looks the same under both motions. `ids` (m,): its tracks.
    """

    last: SecondMotion | None = None
    second_from_first: Array | None = None
    confirmation: Confirmation = field(default_factory=lambda: Confirmation.sought(MotionRules()))
    repeats: bool = False
    ids: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))

    @classmethod
    def none(cls, rules: MotionRules) -> "AmbiguityMemory":
        """Return the memory without an ambiguity."""
        return cls(confirmation=Confirmation.sought(rules))

    @property
    def lasts(self) -> bool:
        """Whether there is an ambiguity."""
        return self.last is not None

    def after(
        self, motion: Resection, before: Tracks, alike: SecondMotion | None = None
    ) -> tuple["AmbiguityMemory", SecondMotion | None, bool]:
        """Return the memory after a frame's motion, and the second motion that may be the camera's.

        The second motion is one for which the scene looks `alike`, or the frame's own, or one that differs from the
        frame's motion as the last one did. `before` (n): the tracks of its views. Also returns whether an ambiguity was
        resolved in favour of the motion followed: the second set proves to be a body in front of the scene, or new
        points have confirmed the motion.
        """
        rules, second = self.confirmation.rules, alike or motion.ambiguous
        if second is not None:
            apart = second.cam_from_ref @ se3.inverse(motion.cam_from_ref)
            ids = self.ids if alike is not None else before.ids[second.views]
            sought = Confirmation.sought(rules, int(before.ids[-1]) + 1)
            return AmbiguityMemory(second, apart, sought, alike is not None, ids), second, False
        remembered = self.second_beside(motion.cam_from_ref)
        if remembered is None:
            return self, None, False
        confirmation = self.confirmation.after(before.ids, motion.accepted)
        if confirmation.is_there or self._is_of_body(motion, before):
            return AmbiguityMemory.none(rules), None, True
        is_one = self.repeats or self._is_explained(motion, before)
        return changed(self, confirmation=confirmation), None if is_one else remembered, False

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
        return bool(n_agree >= MANY_VIEWS and n_agree >= self.confirmation.rules.as_many * np.count_nonzero(its))

    def second_beside(self, cam_from_ref: Array) -> SecondMotion | None:
        """Predict the alternative motion: a given one (4, 4) composed with the last difference."""
        if self.last is None or self.second_from_first is None:
            return None
        return changed(self.last, cam_from_ref=self.second_from_first @ cam_from_ref)
