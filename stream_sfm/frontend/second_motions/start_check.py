"""Checks whether the motion that a map has started with is the camera's, by points that begin later; section 8.

At a start no track has a history, so bodies that cover most of the view outvote the background. Points that begin later
reveal this (`confirmation.py`), unless they are so far away that they agree with either motion; then the motion of the
others does (`motion_choice.py`). Those that cannot belong to the scene (`may_be_scene`) do not count: a body that comes
into view later is found again and again at the same places, and would look like much evidence. Once new points have
confirmed the motion, or no track of the start is left, it is no longer contradicted. The poses before that remain
unconfirmed. The map continues.
"""

from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from ...geometry.evidence import Evidence
from ...geometry.resection import MANY_VIEWS
from ...record import changed, record
from ..rules import MotionRules
from .confirmation import Confirmation


@record
class StartCheck:
    """The `confirmation` by new points since the start.

    `contradicted`: whether they once were against the motion. Tracks of the start have ids below `later_id`; `gone`:
    whether they are no longer followed. `first_share`: the share of tracks that agreed with the motion of the first
    frame, 0 before it. `body`: the evidence that points in front are on a body whose motion others follow, eq. (23g).
    """

    confirmation: Confirmation = field(default_factory=lambda: Confirmation.sought(MotionRules()))
    contradicted: bool = False
    later_id: int = 0
    gone: bool = False
    first_share: float = 0.0
    body: Evidence | None = None

    @classmethod
    def of(cls, rules: MotionRules) -> "StartCheck":
        """Return the check before the first frame."""
        return cls(Confirmation.sought(rules))

    @property
    def rules(self) -> MotionRules:
        return self.confirmation.rules

    @property
    def problem(self) -> str:
        """The problem, or an empty string."""
        if not self.contradicted or self.is_over:
            return ""
        if self.followed_body:
            return (
                "the motion since the start was that of an object in front, until points that begin now confirm another"
            )
        if self.suspects:
            return "far points agree with the motion of near ones since the start: it may be that of an object in front"
        return (
            "too few of the new points agree with the motion since the start: it may be that of an object that moves "
            "through the view"
        )

    @property
    def fills_view(self) -> bool:
        """Whether nearly all of the view had one motion while no track had a history."""
        return self.first_share >= self.rules.calm_start

    @property
    def is_over(self) -> bool:
        """Whether the motion is accepted as the camera's from now on."""
        return self.gone or (self.confirmation.is_there and not self.suspects)

    @property
    def followed_body(self) -> bool:
        """Whether the motion was that of a body, which is no longer followed."""
        return self.body is not None and self.body.is_there

    @property
    def suspects(self) -> bool:
        """Whether the motion may be that of a body which leads other points along."""
        return self.body is not None and not self.body.is_there and self.body.change > self.rules.confirmed_nats

    def begun_with(self, share: float) -> "StartCheck":
        """Return the check with the `share` of a frame's tracks that agree, if it is the first frame."""
        return self if self.first_share else changed(self, first_share=share)

    def after(self, ids: NDArray[np.int64], accepted: NDArray[np.bool_]) -> "StartCheck":
        """Return the check after a frame in which the tracks `ids` (n,), ascending, were found.

        `accepted` (n,): which of them agree with its motion.
        """
        if self.is_over or not len(ids):
            return self
        confirmation = self.confirmation.after(ids, accepted)
        later_id = self.later_id or confirmation.next_id
        gone = bool(np.count_nonzero(accepted & (ids < later_id)) < MANY_VIEWS <= np.count_nonzero(accepted))
        contradicted = self.contradicted or confirmation.contradicted or self.suspects or self.followed_body
        return changed(self, confirmation=confirmation, contradicted=contradicted, later_id=later_id, gone=gone)
