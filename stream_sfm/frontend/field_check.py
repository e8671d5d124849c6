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
    bands = rules.bands
    hidden = columns < 0
    grey = np.where(hidden, np.nan, columns).astype(np.float32) if hidden.any() else columns.astype(np.float32)
    size = (grey.shape[1] - 5) // bands
    if size < 1 or not np.isfinite(grey[:, ::2]).any() or not np.isfinite(grey[:, 1::2]).any():
        return 0.0
    grey[:, ::2] -= np.nanmean(grey[:, ::2]) - np.nanmean(grey[:, 1::2])
    last = grey[:, 5:]
    squares = np.stack([(last - grey[:, 5 - k : -k]) ** 2 for k in (2, 3, 4, 5)])[..., : bands * size]
    known = np.isfinite(squares)
    squares = np.where(known, squares, 0).reshape(4, len(grey), bands, size).sum(axis=(1, 3))
    s2, s3, s4, s5 = squares / np.maximum(known.reshape(4, len(grey), bands, size).sum(axis=(1, 3)), 1)
    excess = (3 * s3 - s2 - 3 * s4 + s5) / 4
    kept = np.argsort(excess)[: -rules.bands_left_out]
    return float(excess[kept].sum() / max(s2[kept].sum(), rules.least_grey2 * len(kept)))
