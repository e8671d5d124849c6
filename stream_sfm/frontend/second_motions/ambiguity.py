"""Remembers a second motion that may be the camera's, until something shows which of the two is.

Two sets of tracks move differently, and nothing shows which of them is static. If one of them leaves the view, this
does not prove that the other one is the background. So the ambiguity continues until points that begin in the meantime
confirm the motion followed (`confirmation.py`). If the scene is repetitive (`repetition.py`), one set has two motions,
and what shows that the scene looks different under the second one ends it.
"""

from dataclasses import field

from ...geometry import Array, se3
from ...geometry.evidence import Evidence
from ...geometry.resection import Resection, SecondMotion
from ...record import changed, record
from ..rules import MotionRules
from ..tracks import Tracks
from .confirmation import Confirmation


@record
class AmbiguityMemory:
    """The `last` second motion, and its difference from the motion followed, `second_from_first` (4, 4).

    `confirmation`: of the motion followed, since the last frame with a second motion. `repeats`: in the last frame the
    scene looked the same under both motions; `unlike`: the evidence that it does not, None before there is any.
    """

    last: SecondMotion | None = None
    second_from_first: Array | None = None
    confirmation: Confirmation = field(default_factory=lambda: Confirmation.sought(MotionRules()))
    repeats: bool = False
    unlike: Evidence | None = None

    @classmethod
    def none(cls, rules: MotionRules) -> "AmbiguityMemory":
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
        resolved in favour of the motion followed, by new points or because the scene no longer looks alike.
        """
        rules, second = self.confirmation.rules, alike or motion.ambiguous
        if second is not None:
            apart = second.cam_from_ref @ se3.inverse(motion.cam_from_ref)
            sought = Confirmation.sought(rules, int(before.ids[-1]) + 1)
            return AmbiguityMemory(second, apart, sought, alike is not None, self.unlike), second, False
        remembered = self.second_beside(motion.cam_from_ref)
        if remembered is None:
            return self, None, False
        confirmation = self.confirmation.after(before.ids, motion.accepted)
        if self.repeats or confirmation.is_there:
            return AmbiguityMemory.none(rules), None, True
        return changed(self, confirmation=confirmation, repeats=False), remembered, False

    def second_beside(self, cam_from_ref: Array) -> SecondMotion | None:
        """Predict the alternative motion: a given one (4, 4) composed with the last difference."""
        if self.last is None or self.second_from_first is None:
            return None
        return changed(self.last, cam_from_ref=self.second_from_first @ cam_from_ref)
