"""Whether rows of both images are of two moments in turn, as of interlaced video.

What moves is combed then: rows next to each other differ by more than the distance between them explains. With S(k) the
mean squared difference of pixels that are k rows apart, S(3) and S(5) are larger than their neighbours S(2) and S(4)
suggest, and S(4) is smaller. In images of one moment S is smooth, also that of noise, which adds the same to each. A
sensor whose even rows are brighter than its odd ones is distinguished from this by their means.
"""

import numpy as np

from ..config.image_rules import FieldRules
from ..record import changed, record
from .still_check import Line, Lines


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
        if all(
            combed(lines.columns[:: self.rules.stride], self.rules) > self.rules.combed for lines in (left, right)
        ):
            lasts = self.rules.lasting_frames
        return changed(self, waiting=self.rules.every - 1, lasts=lasts)


def combed(columns: Line, rules: FieldRules) -> float:
    """Return by how much S(k) of an odd k exceeds what its neighbours suggest, as a share of S(2).

    Of columns (m, h), −1 where they do not show the scene. The bands in which it does so by most do not count, as
    those in which a line is drawn across the image.
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
