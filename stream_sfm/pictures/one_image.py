"""Checks whether one camera is delivered as both: real pairs have disparity."""

from typing import ClassVar

import numpy as np

from ..record import record
from .prepared import PreparedImages
from .rules import ImageRules
from .view import View

_CERTAIN_NATS = 100.0  # two cameras deliver no such images, and one camera only such


@record
class OneImage:
    """Compares pixels of both images, as the cameras have delivered them, on slopes."""

    rules: ImageRules = ImageRules()

    sentence: ClassVar[str] = "left and right are the same image: is one camera recorded as both?"
    of_pair: ClassVar[bool] = True

    @property
    def earlier(self) -> int:
        """No earlier frame."""
        return 0

    def nats(self, images: PreparedImages, views: tuple[View, ...]) -> float | None:
        """Return certainty either way, or None where images have too few slopes."""
        if images.delivered is None:
            return None
        left, right = (image.astype(np.int16) for image in images.delivered[:2])
        on_slope = np.abs(left[:, 2:] - left[:, :-2]) >= self.rules.slope_grey
        if np.count_nonzero(on_slope) < self.rules.fewest_slopes:
            return None
        same = np.abs(left - right)[:, 1:-1][on_slope] <= self.rules.same_grey
        return _CERTAIN_NATS if same.mean() > self.rules.same_share else -_CERTAIN_NATS
