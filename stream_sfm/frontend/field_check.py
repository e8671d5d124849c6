"""Checks whether alternate rows of both images are of two moments, as in interlaced video.

Moving objects are then combed: adjacent rows differ by more than their distance explains. With S(k) the mean squared
difference of pixels k rows apart, S(3) and S(5) are larger than their neighbours S(2) and S(4) suggest, and S(4) is
smaller. In images of one moment S is smooth; noise adds the same amount to each S(k). If a sensor's even rows are
brighter than its odd ones, the means of the rows show it, and the difference is removed.
"""

import numpy as np

from ..config.image_rules import FieldRules
from ..record import changed, record
from .still_check import Line, Lines


@record
class FieldCheck:
    """The evidence so far.

    `waiting`: frames until the next examined one; `lasts`: for how many more frames fields are suspected.
    """

    waiting: int = 0
    lasts: int = 0
    rules: FieldRules = FieldRules()

    @property
    def problem(self) -> str:
        """The problem that rows are of two moments, or an empty string."""
        if not self.lasts:
            return ""
        return "rows of two moments alternate in both images: is this interlaced video? Record whole frames"

    def after(self, left: Lines, right: Lines) -> "FieldCheck":
        """Return the check after a frame, from lines of both raw images."""
        lasts = max(0, self.lasts - 1)
        if self.waiting:
            return changed(self, waiting=self.waiting - 1, lasts=lasts)
        if all(
            combed(lines.columns[:: self.rules.stride], self.rules) > self.rules.combed for lines in (left, right)
        ):
            lasts = self.rules.lasting_frames
        return changed(self, waiting=self.rules.every - 1, lasts=lasts)


def combed(columns: Line, rules: FieldRules) -> float:
    """Return by how much S(k) for odd k exceeds the value that its neighbours suggest, as a share of S(2).

    `columns` (m, h) are −1 where they do not show the scene. The bands with the largest excess do not count, because a
    line may be drawn across the image there.
    """
    bands, grey, known = rules.bands, columns.astype(np.float32), columns >= 0
    lines, size = len(grey), (grey.shape[1] - 5) // rules.bands
    if size < 1 or not known[:, ::2].any() or not known[:, 1::2].any():
        return 0.0
    grey[:, ::2] -= grey[:, ::2].mean(where=known[:, ::2]) - grey[:, 1::2].mean(where=known[:, 1::2])
    whole, means = known.all(), []
    for k in (2, 3, 4, 5):
        squares, n = (grey[:, 5:] - grey[:, 5 - k : -k]) ** 2, lines * size
        if not whole:
            both = known[:, 5:] & known[:, 5 - k : -k]
            squares[~both] = 0
            n = np.maximum(both[:, : bands * size].reshape(lines, bands, size).sum(axis=(0, 2)), 1)
        means.append(squares[:, : bands * size].reshape(lines, bands, size).sum(axis=(0, 2)) / n)
    s2, s3, s4, s5 = means
    excess = (3 * s3 - s2 - 3 * s4 + s5) / 4
    kept = np.argsort(excess)[: -rules.bands_left_out]
    return float(excess[kept].sum() / max(s2[kept].sum(), rules.least_grey2 * len(kept)))
