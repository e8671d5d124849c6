"""Checks whether the motion that a map has started with is the camera's, by points that begin later.

At a start no track has a history, so bodies that cover most of the view outvote the background. Points that begin later
reveal this, because they begin where points are missing, which is on the background. As long as too many of them
disagree, the motion may be that of a body. Points that cannot belong to the scene (`may_be_scene`) do not
count: a body that comes into view later is found again and again at the same places, and would look like much evidence.
Disagreeing points do not count either in a frame whose second motion is that of points in front of the others. Once new
points agree, or no track of the start is left, the motion relies on points that began later and is no longer in doubt.
The poses before that remain unconfirmed. The map continues.
"""

import numpy as np
from numpy.typing import NDArray

from ...config.rules import MotionRules
from ...geometry.resection import MANY_VIEWS
from ...record import changed, record


@record
class StartCheck:
    """The evidence of new points since the start, older ones counting less: how many were `found`, and `agreed`.

    `calm_frames`: consecutive frames in which enough of them agreed. `doubted`: whether once too few agreed. `next_id`:
    the first id of tracks that have not been judged. Tracks of the start have ids below `later_id`; `gone`: whether
    they are no longer followed. `first_share`: the share of tracks that agreed with the motion of the first frame, 0
    before it.
    """

    found: float = 0.0
    agreed: float = 0.0
    calm_frames: int = 0
    doubted: bool = False
    next_id: int = 0
    later_id: int = 0
    gone: bool = False
    first_share: float = 0.0
    rules: MotionRules = MotionRules()

    @property
    def problem(self) -> str:
        """The problem, or an empty string."""
        if not self.doubted or self.is_over:
            return ""
        return (
            f"only {self.agreed / self.found:.0%} of the latest new points agree with the motion since the start: it "
            "may be that of an object that moves through the view"
        )

    @property
    def fills_view(self) -> bool:
        """Whether nearly all of the view had one motion while no track had a history."""
        return self.first_share >= self.rules.calm_start

    @property
    def is_over(self) -> bool:
        """Whether the motion is accepted as the camera's from now on."""
        return self.gone or self.calm_frames >= self.rules.full_history

    def begun_with(self, share: float) -> "StartCheck":
        """Return the check with the `share` of a frame's tracks that agree, if it is the first frame."""
        return self if self.first_share else changed(self, first_share=share)

    def settled(self) -> "StartCheck":
        """Return the check after other evidence has shown that the motion is the camera's."""
        return changed(self, calm_frames=self.rules.full_history, doubted=False)

    def after(self, ids: NDArray[np.int64], accepted: NDArray[np.bool_]) -> "StartCheck":
        """Return the check after a frame in which the tracks `ids` (n,), ascending, were found.

        `accepted` (n,): which of them agree with its motion. Each track is judged once, when it is first found again.
        """
        new, kept = ids >= self.next_id, 1 - 1 / self.rules.full_history
        if self.is_over or not len(ids):
            return self
        next_id = int(ids[-1]) + 1
        later_id = self.later_id or next_id
        now = changed(
            self,
            found=kept * self.found + int(new.sum()),
            agreed=kept * self.agreed + int((new & accepted).sum()),
            next_id=next_id,
            later_id=later_id,
            gone=bool(np.count_nonzero(accepted & (ids < later_id)) < MANY_VIEWS <= np.count_nonzero(accepted)),
        )
        if now.agreed >= self.rules.calm_start * now.found:
            return changed(now, calm_frames=self.calm_frames + 1)
        return changed(now, calm_frames=0, doubted=True)
