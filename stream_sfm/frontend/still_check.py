"""Whether something is drawn over both images: it stays at its pixels, and is at the same ones left and right.

A time or a frame shown on the display, a grid, a hot or a bright column: points on it are in both images and never
move, as if the camera stood and saw them at one distance. Where they are many, they may outvote the scene. What a
standing camera sees has a disparity, and points at infinity move with every turn, so that of the edges of real images
under 1 in 100 are at the same pixels with the same grey values in both images and in the image before, while others
move.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..record import record

_EVERY = 8  # of rows and columns that are looked at
# An edge: grey values that a pixel differs by from one two pixels further. It is the same as another where the pixel is
# about as bright, and the step as large or, on a thin line, of the same sign on both sides.
_FAR_PX, _EDGE_GREY, _SAME_GREY, _SAME_STEP = 2, 16, 3, 4
_REMEMBERED = 10  # frames
# Of all edges: rendered and real logs have up to 0.006; overlays that lead estimates astray have from 0.02 on.
_DRAWN = 0.012
# Of all edges, where the image is by an edge's step brighter or darker than before: with fewer the camera stands, and
# what is drawn does not show.
_MOVING = 0.2
_FEWEST = 500  # edges of which anything is said


Line = NDArray[np.int16]


class Lines(NamedTuple):
    """Every eighth row (k, w) and column (m, h) of an image as it came, −1 where a mask leaves it out."""

    rows: Line
    columns: Line

    @classmethod
    def of(cls, image: NDArray[np.uint8], mask: NDArray[np.bool_] | None = None) -> "Lines":
        """The lines of an image (h, w), of which a mask (h, w) is false where it does not show the scene."""
        lines = cls(*(side[::_EVERY].astype(np.int16, order="C") for side in (image, image.T)))
        if mask is not None:
            lines.rows[~mask[::_EVERY]] = lines.columns[~mask.T[::_EVERY]] = -1
        return lines


@record
class StillCheck:
    """What the frames so far have shown: the left lines of the latest one, and of each of the latest how many edges
    there are, and how many of them are drawn over both images."""

    left: Lines | None = None
    counts: tuple[tuple[int, int], ...] = ()

    @property
    def problem(self) -> str:
        """Say that something is drawn over both images; or nothing."""
        edges, drawn = np.sum(self.counts, axis=0) if self.counts else (0, 0)
        if edges < _FEWEST or drawn < _DRAWN * edges:
            return ""
        return (
            f"{drawn / edges:.0%} of the edges stay at the same pixels of both images while the rest moves: is "
            "something drawn over them? A mask can leave it out"
        )

    def after(self, left: Lines, right: Lines) -> "StillCheck":
        """Return the check after a frame, by lines of its images."""
        before = self.left
        comparable = before is not None and [line.shape for line in before] == [line.shape for line in left]
        if before is None or not comparable or [line.shape for line in right] != [line.shape for line in left]:
            return StillCheck(left, self.counts)
        counts = np.sum([_counts(*lines) for lines in zip(left, right, before, strict=True)], axis=0)
        edges, moved, drawn = (int(count) for count in counts)
        seen = (0, 0) if moved < _MOVING * edges else (edges, drawn)
        return StillCheck(left, (*self.counts, seen)[-_REMEMBERED:])


def _counts(left: Line, right: Line, before: Line) -> tuple[int, int, int]:
    """How many edges are in lines (k, n) of the left image, at how many of their pixels it has changed since the one
    `before`, and how many are the same there and in the right image."""
    grey, back, ahead = left[:, _FAR_PX:-_FAR_PX], left[:, : -2 * _FAR_PX], left[:, 2 * _FAR_PX :]
    at = (grey >= 0) & ((np.abs(grey - back) >= _EDGE_GREY) | (np.abs(grey - ahead) >= _EDGE_GREY))
    rows, columns = at.nonzero()
    pixels = rows * left.shape[1] + columns + _FAR_PX
    edges, then, there = _with_steps(left, pixels), _with_steps(before, pixels), _with_steps(right, pixels)
    moved = np.abs(edges[0] - then[0]) >= _EDGE_GREY
    drawn = _same(edges, then) & _same(edges, there)
    return len(moved), int(np.count_nonzero(moved)), int(np.count_nonzero(drawn))


def _with_steps(lines: Line, pixels: NDArray[np.intp]) -> Line:
    """Return (3, n): pixels (n,) of lines, counted through all of them, and how they differ from either side."""
    flat = lines.ravel()
    grey = flat.take(pixels)
    return np.stack([grey, grey - flat.take(pixels - _FAR_PX), grey - flat.take(pixels + _FAR_PX)])


def _same(edges: Line, others: Line) -> NDArray[np.bool_]:
    """Which edges (3, n), pixels with their steps, are the same as others."""
    steps, other = edges[1:], others[1:]
    steep = np.abs(steps) >= _EDGE_GREY
    as_large = (steep & (np.abs(steps - other) <= _SAME_STEP)).any(axis=0)
    alike = (steep & (np.abs(other) >= _EDGE_GREY) & (np.sign(steps) == np.sign(other))).all(axis=0)
    line = alike & (np.sign(steps[0]) == np.sign(steps[1]))
    return np.asarray((np.abs(edges[0] - others[0]) <= _SAME_GREY) & (as_large | line))
