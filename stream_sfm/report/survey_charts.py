"""Charts of the errors at surveyed test points: in the world, of distances between the points, and in the image."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from .lengths import in_readable_unit
from .methods import label, style
from .svg import Chart, Series, draw

ByFrame = Sequence[dict[str, Any]]  # `by_frame` of the errors of one method


def at_test_points(methods: Mapping[str, ByFrame]) -> list[Markup]:
    """Three charts over the frames; with one method its estimated σ beside each error."""
    return [
        _chart(
            "Position in the world (WC)",
            "position",
            methods,
            "seen by both cameras, carried by the estimated pose",
        ),
        _chart(
            "Distances between the points (CC)",
            "distance",
            dict(list(methods.items())[:1]),
            "of pairs in one frame: no pose is part of it",
            shared=len(methods) > 1,
        ),
        _chart("Position in the left image", "image", methods, "surveyed point, projected from the estimated pose"),
    ]


def _chart(title: str, what: str, methods: Mapping[str, ByFrame], note: str, shared: bool = False) -> Markup:
    unit = "px" if what == "image" else "m"
    series = []
    for name, rows in methods.items():
        named, colour = ("all methods", "m-truth") if shared else (label(name), style(name))
        series.append(_series(named, rows, f"{what}_rms_{unit}", colour))
        if len(methods) == 1 and not shared:
            series.append(_series("estimated σ", rows, f"{what}_sigma_{unit}", "m-truth", dots=False))
    if unit == "m":
        series, unit = in_readable_unit(series)
    return draw(Chart(title, "frame", f"RMS, {unit}", series, note=note, zero=True))


def _series(name: str, rows: ByFrame, key: str, colour: str, dots: bool = True) -> Series:
    known = [row for row in rows if row[key] is not None]
    x, y = (np.array([row[k] for row in known], float) for k in ("frame", key))
    return Series(name, x, y, colour, dots=dots)
