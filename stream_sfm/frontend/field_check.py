"""Whether rows of both images are of two moments in turn, as of interlaced video.

What moves is combed then: rows next to each other differ by more than the distance between them explains. With S(k) the
mean squared difference of pixels that are k rows apart, S(3) and S(5) are larger than their neighbours S(2) and S(4)
suggest, and S(4) is smaller. In images of one moment S is smooth, also that of noise, which adds the same to each. A
sensor whose even rows are brighter than its odd ones is told from this by their means.
"""

import numpy as np

from ..config.rules import FieldRules
from ..record import changed, record
from .still_check import Line, Lines

_STRIDE = 2  # of the columns that are there
_FEWEST = 8  # rows
_LEAST = 1.0  # grey values squared: of images without texture


@record
class FieldCheck:
    """What the frames so far have shown: `waiting`: frames until the next one that is looked at; `lasts`: for how many
    frames fields are still suspected."""

    waiting: int = 0
    lasts: int = 0
    rules: FieldRules = FieldRules()

    @property
    def problem(self) -> str:
        """Say that rows are of two moments; or nothing."""
        if not self.lasts:
            return ""
        return "rows of two moments alternate in both images: is this interlaced video? Record whole frames"

    def after(self, left: Lines, right: Lines) -> "FieldCheck":
        """Return the check after a frame, by lines of both images as they came."""
        lasts = max(0, self.lasts - 1)
        if self.waiting:
            return changed(self, waiting=self.waiting - 1, lasts=lasts)
        if min(combed(lines.columns[::_STRIDE]) for lines in (left, right)) > self.rules.combed:
            lasts = self.rules.lasting_frames
        return changed(self, waiting=self.rules.every - 1, lasts=lasts)


def combed(columns: Line) -> float:
    """By how much more than its neighbours suggest S(k) is for an odd k, share of S(2); of columns (m, h), −1 where
    they do not show the scene."""
    grey, hidden = columns.astype(np.float32), columns < 0
    mean = np.mean
    if hidden.any():
        grey = grey[~hidden.all(axis=1)]
        grey[grey < 0], mean = np.nan, np.nanmean
    if grey.shape[1] < _FEWEST or not len(grey):
        return 0.0
    grey[:, ::2] -= mean(grey[:, ::2]) - mean(grey[:, 1::2])
    last = grey[:, 5:]
    s2, s3, s4, s5 = (float(mean((last - grey[:, 5 - k : -k]) ** 2)) for k in (2, 3, 4, 5))
    excess = (3 * s3 - s2 - 3 * s4 + s5) / 4
    return excess / max(s2, _LEAST) if np.isfinite(excess) else 0.0
