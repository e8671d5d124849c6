"""The figures of runs as pages and tables list them: name, unit, and which value is best."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from .lengths import LengthUnit
from .template import sig
from .verdict import NEES_INTERVAL


class Figure(NamedTuple):
    """A figure by its key in summary.json or report.json.

    `unit`: "errors" or "structure" for lengths, whose unit the page chooses; `best`: whether the smallest value is
    marked; `expected`: values outside this range are marked.
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
WITHOUT_TRUTH = (
    Figure("divergence_from_cross_frame_m", "away from cross-frame", "errors"),
    Figure("end_std_position_m", "σ at the end", "errors"),
    Figure("end_std_heading_deg", "σ of the heading", "°"),
    Figure("nis_over_dof", "NIS", "1 expected"),
)
FURTHER = (
    Figure("ate_rmse_m", "ATE", "errors"),
    Figure("scale_error_percent", "scale", "%"),
    Figure("local_structure_median_m", "local structure", "structure"),
    Figure("local_structure_error_over_sigma", "… over σ", "1 expected"),
)
OF_COMPARISON = (
    *FURTHER,
    Figure("rpe_position_rms_m", "error per frame", "errors"),
    Figure("rpe_rotation_rms_deg", "rotation per frame", "°"),
    Figure("growth_exponent", "growth", "1 random, 2 bias"),
    Figure("nis_over_dof", "NIS", "1 expected"),
    Figure("reprojection_rms_px", "reprojection", "px"),
)


class Table(NamedTuple):
    """Headings with their units, and rows of cells: text and how it is marked, "best", "bad" or empty."""

    headings: list[tuple[str, str]]
    rows: list[list[tuple[str, str]]]

    def turned(self, names: Sequence[str]) -> "Table":
        """A row per figure and a column per run, without figures that no run has."""
        rows = []
        for k, (name, unit) in enumerate(self.headings):
            if any("–" not in row[k][0] for row in self.rows):
                rows.append([(f"{name}, {unit}" if unit else name, ""), *(row[k] for row in self.rows)])
        return Table([("", ""), *((name, "") for name in names)], rows)


def table(figures: Sequence[Figure], runs: Sequence[dict[str, Any]], units: dict[str, LengthUnit]) -> Table:
    """The figures of some runs, a row each; the best of several values is marked."""
    columns = []
    for figure in figures:
        unit = units.get(figure.unit)
        values = [run.get(figure.key) for run in runs]
        known = [abs(v) for v in values if v is not None]
        least = min(known) if figure.best and len(known) > 1 else None
        columns.append([(sig(v, unit.per_m if unit else 1.0), _mark(figure, v, least)) for v in values])
    headings = [(f.name, units[f.unit].name if f.unit in units else f.unit) for f in figures]
    return Table(headings, [[column[k] for column in columns] for k in range(len(runs))])


def _mark(figure: Figure, value: float | None, least: float | None) -> str:
    if value is None:
        return ""
    if figure.expected is not None and value > figure.expected[1]:
        return "bad"
    return "best" if least is not None and abs(value) == least else ""
