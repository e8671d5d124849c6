"""The figures of runs as tables of a page: their names and units, which value is best, and how numbers are written."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike

NEES_INTERVAL = (1.24, 14.45)  # 95 % of one pose, 6 expected: poses of a log share their errors and say hardly more


class LengthUnit(NamedTuple):
    """A unit of length: its name, and how many of them are a metre."""

    name: str
    per_m: float


METRES, MILLIMETRES = LengthUnit("m", 1.0), LengthUnit("mm", 1e3)


def unit_for(*lengths_m: ArrayLike) -> LengthUnit:
    """Millimetres where all of a family of lengths that are known are below a metre, else metres."""
    known = np.concatenate([np.empty(0), *(np.asarray(x, float).ravel() for x in lengths_m)])
    return METRES if (abs(known) >= 1).any() else MILLIMETRES


class Figure(NamedTuple):
    """A figure by its key in summary.json or report.json.

    `unit`: "errors" or "structure" for lengths, whose unit the page chooses; `best`: whether the smallest value is
    marked; `expected`: values above this range are marked.
    """

    key: str
    name: str
    unit: str = ""
    best: bool = False
    expected: tuple[float, float] | None = None


ACCURACY = (
    Figure("ate_rmse_aligned_m", "ATE aligned", "errors", best=True),
    Figure("final_drift_percent", "final drift", "%", best=True),
    Figure("t_rel_percent", "t_rel", "%", best=True),
    Figure("r_rel_deg_per_100m", "r_rel", "°/100 m", best=True),
    Figure("nees_pose_mean", "NEES", "6 expected", expected=NEES_INTERVAL),
)
FURTHER = (
    Figure("ate_rmse_m", "ATE", "errors"),
    Figure("scale_error_percent", "scale", "%"),
    Figure("local_structure_median_m", "local structure", "structure"),
    Figure("local_structure_error_over_sigma", "… over σ", "1 expected"),
)
TIME = Figure("ms_per_frame_p50", "time", "ms per frame")
FRAMES = Figure("frames", "frames")


class Name(NamedTuple):
    """What a row is of: its name, a note below it, the colour of its lines (a variable of page.css), and a link."""

    text: str
    note: str = ""
    colour: str = ""
    href: str = ""


class Table(NamedTuple):
    """Headings with their units, and rows of cells: text and its class, "best", "bad", "wrap" or empty."""

    headings: list[tuple[str, str]]
    rows: list[tuple[Name, list[tuple[str, str]]]]


def table(
    figures: Sequence[Figure],
    names: Sequence[Name],
    runs: Sequence[dict[str, Any]],
    units: dict[str, LengthUnit],
) -> Table:
    """The figures of some runs, a row each, without those that no run has; the best of several values is marked."""
    headings, columns = [], []
    for figure in figures:
        values = [run.get(figure.key) for run in runs]
        if all(value is None for value in values):
            continue
        unit = units.get(figure.unit, LengthUnit(figure.unit, 1.0))
        sizes = [abs(v) for v in values if v is not None] if figure.best else []
        least = min(sizes) if len(sizes) > 1 else None
        headings.append((figure.name, unit.name))
        columns.append([(text_of(v, unit.per_m), _mark(figure, v, least)) for v in values])
    return Table(headings, [(name, [column[k] for column in columns]) for k, name in enumerate(names)])


def _mark(figure: Figure, value: Any, least: float | None) -> str:
    if isinstance(value, str):
        return "wrap"
    if value is not None and figure.expected is not None and value > figure.expected[1]:
        return "bad"
    return "best" if value is not None and least is not None and abs(value) == least else ""


def text_of(value: Any, factor: float = 1.0) -> str:
    """A number with three significant digits, or all before the point; integers and texts as they are.

    A ratio with its interval is written as ×1.42 [1.1, 1.8], and None as a dash.
    """
    if value is None:
        return Markup('<span class="nil">–</span>')
    if isinstance(value, dict):
        interval = Markup(" <small>[{:.2f}, {:.2f}]</small>").format(*value["ci95"])
        return Markup("×{:.2f}{}").format(value["value"], interval)
    if isinstance(value, str | int):
        return value if isinstance(value, str) else str(value)
    x = factor * value
    # of large numbers all digits before the point
    return (f"{x:.0f}" if 1000 <= abs(x) < 1e6 else f"{x:#.3g}").rstrip(".").replace("-", "−")
