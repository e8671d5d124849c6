"""Checks whether something is drawn over both images, which stays at the same pixels of the left and right image.

It may be a time stamp, a frame, a grid, or a hot column of the sensor. Its points are in both images and never move, as
if the camera stood still and saw them at one distance. If they are many, they may outvote the scene. Real objects have
a disparity, and points at infinity move with every turn. So while other edges move, less than 1 in 200 edges of real
images have the same pixels and grey values in both images, in the last examined images and in those some frames
earlier.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..config.image_rules import StillRules
from ..record import changed, record

Line = NDArray[np.int16]


class Lines(NamedTuple):
    """Some rows (k, w) and columns (m, h) of a raw image, −1 where a mask excludes it."""

    rows: Line
    columns: Line

    @classmethod
    def of(cls, image: NDArray[np.uint8], rules: StillRules, mask: NDArray[np.bool_] | None = None) -> "Lines":
        """Return the lines of an image (h, w); its mask (h, w) is false where it does not show the scene."""
        every = rules.spacing_px
        rows, columns = image[::every].astype(np.int16), image.T[::every].astype(np.int16, order="C")
        if mask is not None:
            rows[~mask[::every]] = -1
            columns[~mask.T[::every]] = -1
        return cls(rows, columns)


@record
class StillCheck:
    """The evidence of the examined frames.

    `lefts`: the left lines of the latest ones; `counts`: for each of the latest, the number of edges, and how many of
    these are drawn over both images.
    """

    lefts: tuple[Lines, ...] = ()
    counts: tuple[tuple[int, int], ...] = ()
    rules: StillRules = StillRules()

    @property
    def problem(self) -> str:
        """The problem that something is drawn over both images, or an empty string."""
        edges, drawn = np.sum(self.counts, axis=0) if self.counts else (0, 0)
        if edges < self.rules.fewest or drawn < self.rules.drawn * edges:
            return ""
        return (
            f"{drawn / edges:.0%} of the edges stay at the same pixels of both images while the rest moves: is "
            "something drawn over them? A mask can exclude it"
        )

    def after(self, left: Lines, right: Lines) -> "StillCheck":
        """Return the check after a frame, from lines of its images."""
        rules, lefts = self.rules, self.lefts
        apart = max(1, rules.apart_frames // rules.every)
        shapes = [line.shape for line in left]
        if [line.shape for line in right] != shapes or (lefts and [line.shape for line in lefts[-1]] != shapes):
            return changed(self, lefts=(left,))
        lefts = (*lefts, left)[-apart - 1 :]
        if len(lefts) <= apart:
            return changed(self, lefts=lefts)
        limits = rules.edge_grey, rules.same_grey, rules.same_step_grey
        lines = zip(left, lefts[-2], lefts[0], right, strict=True)
        edges, moved, drawn = map(sum, zip(*(core.drawn_edges(*each, *limits) for each in lines), strict=True))
        seen = (0, 0) if moved < rules.moving * edges else (edges, drawn)
        return changed(self, lefts=lefts, counts=(*self.counts, seen)[-rules.remembered :])
