"""Lengths in a unit in which their numbers are easy to read."""

from dataclasses import replace

import numpy as np

from .svg import Series

_MILLIMETRES_BELOW_M = 0.1


def in_readable_unit(series: list[Series]) -> tuple[list[Series], str]:
    """Series of lengths, given in metres, in millimetres where all are short, and the name of the unit."""
    finite = [s.y[np.isfinite(s.y)] for s in series]
    if all(not len(y) or y.max() < _MILLIMETRES_BELOW_M for y in finite):
        return [replace(s, y=1e3 * s.y) for s in series], "mm"
    return series, "m"
