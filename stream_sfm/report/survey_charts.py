"""Charts of the errors at surveyed test points: in the world, of distances between the points, and in the image."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from .lengths import LengthUnit
from .methods import label, style
from .svg import Chart, Series, draw

ByFrame = Sequence[dict[str, Any]]  # `by_frame` of the errors of one method


def at_test_points(methods: Mapping[str, ByFrame], unit: LengthUnit) -> list[Markup]:
    """Three charts over the frames; with one method its estimated σ beside each error."""
    first = dict(list(methods.items())[:1])
    shared = len(methods) > 1  # distances are those of any method
    return [
        _chart("Position in the world (WC)", "position_rms_m", methods, unit, "carried by the estimated pose"),
        _chart("Distances between the points (CC)", "distance_rms_m", first, unit, "no pose is part of it", shared),
        _chart("Position in the left image", "image_rms_px", methods, None, "projected from the estimated pose"),
    ]


def _chart(
    title: str, key: str, methods: Mapping[str, ByFrame], length: LengthUnit | None, note: str, shared: bool = False
) -> Markup:
    series = []
    for name, rows in methods.items():
        named, colour = ("all methods", "m-truth") if shared else (label(name), style(name))
        series.append(_series(named, rows, key, colour))
        if len(methods) == 1 and not shared:
            series.append(_series("estimated σ", rows, key.replace("rms", "sigma"), "m-truth", dots=False))
    unit = "px" if length is None else length.name
    return draw(
        Chart(title, "frame", f"RMS, {unit}", length.of(series) if length else series, note=note, zero=True)
    )


def _series(name: str, rows: ByFrame, key: str, colour: str, dots: bool = True) -> Series:
    known = [row for row in rows if row[key] is not None]
    x, y = (np.array([row[k] for row in known], float) for k in ("frame", key))
    return Series(name, x, y, colour, dots=dots)
