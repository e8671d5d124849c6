"""Whether both images have been displaced at once: a crop or a synchronisation that has changed.

All points are then displaced alike, which looks like a turn of the camera between two frames, before and after which it
moves on as it did. A camera has mass: where it turns, its velocity changes and stays changed. So a motion that differs
from the last one as none before it is suspected; where the next one is as before, a step has been seen. Whether the
camera has made it cannot be told: the frames count as before, and their poses may be off by the step.
"""

import numpy as np

from ..config.rules import StepRules
from ..geometry.se3 import Array
from ..record import record


@record
class StepCheck:
    """What the changes of motion so far were: the sizes of the latest ones, pixels; `suspected` (6,): the change in the
    last frame, if it may be a step; `confirmed_px`: the size of a step that the last frame has confirmed, or 0."""

    sizes_px: tuple[float, ...] = ()
    suspected: Array | None = None
    confirmed_px: float = 0.0
    rules: StepRules = StepRules()

    @property
    def problem(self) -> str:
        """Say that a step has been seen, in the frame that confirms it; or nothing."""
        if not self.confirmed_px:
            return ""
        return (
            f"the view has turned by {self.confirmed_px:.0f} px at once: have both images been displaced, by another "
            "crop or lost synchronisation?"
        )

    def after(self, change: Array | None, f_px: float) -> "StepCheck":
        """Return the check after a frame whose motion differs from the last one by `change` (6,); None: not known."""
        rules = self.rules
        if change is None:
            return StepCheck(self.sizes_px, rules=rules)
        turn_px = f_px * change[3:]
        size = float(np.linalg.norm(turn_px))
        if self.suspected is not None:
            step_px = f_px * self.suspected[3:]
            if np.linalg.norm(turn_px + step_px) < rules.back * np.linalg.norm(step_px):
                return StepCheck(self.sizes_px, confirmed_px=float(np.linalg.norm(step_px)), rules=rules)
        usual = float(np.median(self.sizes_px)) if len(self.sizes_px) >= rules.fewest else np.inf
        unusual = size > max(rules.least_px, rules.unusual * usual)
        return StepCheck((*self.sizes_px, size)[-rules.remembered :], change if unusual else None, rules=rules)
