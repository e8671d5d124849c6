"""Whether both images have been displaced at once: a crop or a synchronisation that has changed.

All points are then displaced alike, which looks like a turn of the camera between two frames, before and after which it
moves on as it did. A camera has mass: where it turns, its velocity changes and stays changed. So a motion that differs
from the last one as none before it is suspected; where the next one is as before, a step has been seen. Whether the
camera has made it cannot be told: the frames count as before, and their poses may be off by the step.
"""

import numpy as np

from ..geometry.se3 import Array
from ..record import record

# Pixels that a step moves the image by at least, and over the median of the last changes of a motion; on sample logs,
# and hand-held ones, changes that are undone by the next frame stay below a third of this.
_LEAST_PX = 2.0
_UNUSUAL = 6.0
_REMEMBERED, _FEWEST = 20, 5
_BACK = 0.5  # of a step: how much of the change the next frame leaves


@record
class StepCheck:
    """What the changes of motion so far were: the sizes of the latest ones, pixels; `suspected` (6,): the change in the
    last frame, perturbation of its motion on the right, if it is suspected to be a step; and `px`, how large it is."""

    sizes_px: tuple[float, ...] = ()
    suspected: Array | None = None
    px: float = 0.0

    @property
    def problem(self) -> str:
        """Say that the latest frame may have been displaced; or nothing."""
        if self.suspected is None:
            return ""
        return (
            f"the view has turned by {self.px:.0f} px at once: have both images been displaced, by another crop "
            "or lost synchronisation?"
        )

    def after(self, change: Array | None, f_px: float) -> tuple["StepCheck", bool]:
        """Return the check after a frame whose motion differs from the last one by `change` (6,); None: not known.

        Also returns whether this frame has confirmed a step in the last one.
        """
        if change is None:
            return StepCheck(self.sizes_px), False
        turn_px = f_px * change[3:]
        size = float(np.linalg.norm(turn_px))
        if self.suspected is not None and np.linalg.norm(turn_px + f_px * self.suspected[3:]) < _BACK * self.px:
            return StepCheck(self.sizes_px), True
        usual = float(np.median(self.sizes_px)) if len(self.sizes_px) >= _FEWEST else np.inf
        if size > max(_LEAST_PX, _UNUSUAL * usual):
            return StepCheck(self.sizes_px, change, size), False
        return StepCheck((*self.sizes_px, size)[-_REMEMBERED:]), False
