"""Whether the motion that a map has started with is the camera's, judged by the points that begin meanwhile.

At a start no track has a history, so bodies that cover most of the view outvote the background. Points that begin
later reveal this, because they begin where points are missing, which is on the background. As long as too many of them
disagree, the motion may be that of a body. Once they agree, the start is redone from there. Points that cannot be the
scene (`depth_order.may_be_scene`) do not count: a body that comes into view later is found again and again at the same
places, and would pass for many witnesses. Once no track of the start is left, the motion rests on points that began
later and is no longer in doubt, but nothing has confirmed the poses up to there.
"""

import numpy as np
from numpy.typing import NDArray

from ..config.rules import MotionRules
from ..geometry.resection import MANY_VIEWS
from ..record import changed, record


@record
class StartCheck:
    """What new points have shown since the start, older ones counting less: how many were `found`, and `agreed`.

    `calm_frames` in a row in which enough of them agreed. `doubted`: since the start they once did not. `next_id`: of
    the tracks that have not been judged; those of the start are below `later_id`. `gone`: they are not followed now.
    `first_share`: of the tracks of the first frame that agreed with its motion, 0 before it.
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
        """What is wrong, or an empty string."""
        if not self.doubted or self.is_over:
            return ""
        return (
            f"of the points that have begun lately {self.agreed / self.found:.0%} agree with the motion since the "
            "start: it may be that of something that moves through the view"
        )

    @property
    def fills_view(self) -> bool:
        """Whether nearly all of the view had one motion while nothing had a history."""
        return self.first_share >= self.rules.calm_start

    @property
    def is_over(self) -> bool:
        """Whether the motion is taken for the camera's for good, or the start is to be redone."""
        return self.gone or self.calm_frames >= self.rules.full_history

    @property
    def is_redone(self) -> bool:
        """Whether the start is to be redone: what was doubted is still followed, and points agree now."""
        return self.doubted and self.is_over and not self.gone

    def begun_with(self, share: float) -> "StartCheck":
        """Return the check with the share of the tracks in a frame that agree, if that is the first one."""
        return self if self.first_share else changed(self, first_share=share)

    def settled(self) -> "StartCheck":
        """Return the check where it is known otherwise that the motion is the camera's."""
        return changed(self, calm_frames=self.rules.full_history, doubted=False)

    def after(self, ids: NDArray[np.int64], accepted: NDArray[np.bool_]) -> "StartCheck":
        """Return the check after a frame in which the tracks `ids` (n,), ascending, were found.

        Those `accepted` (n,) agree with its motion. Each track is judged once, when it is first found again.
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
