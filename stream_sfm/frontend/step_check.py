"""Checks whether both images have been displaced at once, by a changed crop or synchronisation.

All points are then displaced alike. This looks like a turn of the camera between two frames, or like a step to the side
if all points are equally far; before and after it the camera moves as usual. A camera has mass: if it really moves, its
velocity changes and stays changed. So a motion is suspected if it displaces points unlike the last one and by more than
any before. If the next motion is as before, a step is confirmed. Whether the camera has made the step is unknown: the
frames count as before, and their poses may be off by the step.
"""

import numpy as np

from ..config.rules import StepRules
from ..geometry import Array
from ..geometry.medians import median
from ..record import record


@record
class StepCheck:
    """The changes of motion so far.

    `sizes_px`: the sizes of the latest ones; `suspected_px` (3,): the change in the last frame, if it may be a step;
    `confirmed_px`: the size of a step that the last frame has confirmed, or 0.
    """

    sizes_px: tuple[float, ...] = ()
    suspected_px: Array | None = None
    confirmed_px: float = 0.0
    rules: StepRules = StepRules()

    @property
    def problem(self) -> str:
        """The problem of a step, in the frame that confirms it; otherwise an empty string."""
        if not self.confirmed_px:
            return ""
        return (
            f"the view has moved by {self.confirmed_px:.0f} px at once: have both images been displaced, by another "
            "crop or lost synchronisation?"
        )

    def after(self, change_px: Array | None) -> "StepCheck":
        """Return the check after a frame whose motion differs from the last one by `change_px` (3,); None if unknown.

        `displacement_px` computes it.
        """
        rules = self.rules
        if change_px is None:
            return StepCheck(self.sizes_px, rules=rules)
        size = float(np.linalg.norm(change_px))
        if self.suspected_px is not None:
            step = float(np.linalg.norm(self.suspected_px))
            if np.linalg.norm(change_px + self.suspected_px) < rules.back * step:
                return StepCheck(self.sizes_px, confirmed_px=step, rules=rules)
        usual = median(np.array(self.sizes_px)) if len(self.sizes_px) >= rules.fewest else np.inf
        unusual = size > max(rules.least_px, rules.unusual * usual)
        return StepCheck((*self.sizes_px, size)[-rules.remembered :], change_px if unusual else None, rules=rules)


def displacement_px(change: Array, f_px: float, inverse_depth: float) -> Array:
    """Return the displacement (3,) px of the view by a change of motion (6,): of its centre, and by a turn about that.

    `inverse_depth`: of the points, 1/m. Motions are those of points from one camera to the next.
    """
    step, turn = inverse_depth * change[:3], change[3:]
    return np.asarray(f_px * np.array([step[0] + turn[1], step[1] - turn[0], turn[2]]))
