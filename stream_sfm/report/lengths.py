"""The unit in which a page gives one family of lengths, such as all errors of position: charts and tables alike."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .svg import Series


class LengthUnit(NamedTuple):
    """A unit of length: its name, and how many of them are a metre."""

    name: str
    per_m: float

    def of(self, series: Sequence[Series]) -> list[Series]:
        """Series of lengths in metres, in this unit."""
        return [replace(s, y=self.per_m * s.y) for s in series]


METRES, MILLIMETRES = LengthUnit("m", 1.0), LengthUnit("mm", 1e3)


def unit_for(*lengths_m: ArrayLike | None) -> LengthUnit:
    """Millimetres where all lengths that are known are below a metre, else metres."""
    known = [np.asarray(x, float).ravel() for x in lengths_m if x is not None]
    values = np.concatenate([x[np.isfinite(x)] for x in known]) if known else np.empty(0)
    return MILLIMETRES if not len(values) or np.abs(values).max() < 1 else METRES
