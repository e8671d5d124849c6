"""The page of a Monte Carlo study: its tables in words, and charts of their content."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from ..evaluation.relative import Interval
from ..simulation.measure import QUANTITIES
from ..simulation.tables import StudyTable, curve_in_words, in_words, tables, text_of
from .svg import Chart, Row, Series, draw, intervals
from .tables import Name, Table, of_method, render

# Keys of figure 6 that are drawn as a picture.
_CURVES = ("cross-frame", "ekf", "iterated-ekf", "frame-to-frame", "bound")
_TITLES = {
    "efficiency": "how close each estimator comes to the Cramér–Rao bound",
    "consistency": "whether estimated covariances match the errors",
    "calibration": "estimates with a wrong calibration and lasting errors of views",
    "rates": "the paper's Table 1: how error variances grow",
    "figure6": "the paper's Figure 6: errors over the sequence",
}


def render_study(report: dict[str, Any]) -> str:
    """Render the content of results.json as HTML."""
    found = [table for table in tables(report) if not table.whole]
    drawn = [*(chart for table in found for chart in _forest(table)), *_laws(report), *_over_frames(report)]
    return render(
        "study.html.j2",
        title=f"{report['experiment']}: {_TITLES[report['experiment']]}",
        report=report,
        tables=[(table.title, _as_table(table)) for table in found],
        has_intervals=any(isinstance(value, Interval) for table in found for _, row in table.rows for value in row),
        charts=drawn,
    )


def _as_table(table: StudyTable) -> Table:
    rows = []
    for names, values in table.rows:
        first = of_method(names[0]).name if table.names[0] == "estimator" else names[0]
        first = first.replace(" = ", "\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}")
        note = ", ".join(of_method(name).name for name in names[1:])
        rows.append((Name(first, note), [(_cell(value), "") for value in values]))
    headings = (column.partition(", ") for column in table.columns)
    return Table([(of_method(head).name, unit) for head, _, unit in headings], rows)


def _cell(value: Interval | float | None) -> str:
    if isinstance(value, Interval):
        return Markup("{:.2f} <small>[{:.2f}, {:.2f}]</small>").format(value.value, value.low, value.high)
    return text_of(value)


def _forest(table: StudyTable) -> Iterator[Markup]:
    """Yield a chart per condition of a table of ratios, where 1 is best: estimators with their intervals."""
    if table.best is None:
        return
    for condition in dict.fromkeys(names[0] for names, _ in table.rows):
        for k, column in enumerate(table.columns[:2]):  # rotation and position
            rows = [
                Row(of_method(names[1]).name, value.value, value.low, value.high, of_method(names[1]).colour)
                for names, values in table.rows
                if names[0] == condition and isinstance(value := values[k], Interval) and value.low > 0
            ]
            if rows:
                yield intervals(f"{column}, {condition}", "ratio", rows, f"{table.title[:1].lower()}{table.title[1:]}")


def _laws(report: dict[str, Any]) -> Iterator[Markup]:
    """Yield charts of the rates: drift by the span of a point, and local structure by the window, beside theory."""
    if drift := report.get("drift_over_span"):
        lines = [("rotation", "rotation_relative", "c1"), ("position", "position_relative", "c2")]
        yield _law("Drift by the span of a point", drift, "span_frames", [*lines, ("theory", "theory", "truth")])
    if structure := report.get("structure_over_window"):
        measured = structure | {"relative": [value["value"] for value in structure["relative"]]}
        lines = [("bound", "relative", "c1"), ("theory", "theory", "truth")]
        yield _law("Local structure by the window", measured, "window_frames", lines)


def _law(title: str, found: dict[str, Any], x: str, lines: Sequence[tuple[str, str, str]]) -> Markup:
    frames = np.array(found[x])
    series = [Series(name, frames, np.array(found[key]), colour, dots=True) for name, key, colour in lines[::-1]]
    return draw(Chart(title, "frames", "relative variance", series, log_x=True, log_y=True))


def _over_frames(report: dict[str, Any]) -> Iterator[Markup]:
    """Yield charts of figure 6: the errors of a few estimators over the sequence."""
    for quantity in QUANTITIES if "curves" in report else ():
        x, unit = np.array(report["frames"]), "mrad" if quantity == "rotation" else "mm"
        series = [
            Series(
                of_method(curve_in_words(label)).name,
                x,
                1e3 * np.array(report["curves"][label][quantity], float),
                "truth" if label == "bound" else of_method(label).colour,
            )
            for label in _CURVES
            if label in report["curves"]
        ]
        yield draw(Chart(in_words(quantity), "frame", f"RMS error, {unit}", series, zero=True))
