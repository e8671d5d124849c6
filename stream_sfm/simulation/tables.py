"""The results of a study as tables in words: for the terminal, a page, CSV and LaTeX."""

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ..evaluation.figures import number_text
from ..evaluation.relative import Interval
from ..record import record
from ..system.wording import counted
from .figure6 import KINDS
from .measure import QUANTITIES
from .studies import Report

Value = Interval | float | None
_WORDS = {
    "nominal": "round-off noise",
    "noise_1.155px": "noise of 1.155 px",
    "200_frames": "200 frames",
    "wrong_rig_lasting_errors": "wrong rig, lasting errors",
    "wrong_rig": "wrong rig, white errors",
    "lasting_errors": "right rig, lasting errors",
    "non_transitory_slow": "points seen in all frames",
    "simple_slow": "2 frames per point",
    "simple_lateral": "2 frames per point, fast",
    "general_slow": "8 frames per point",
    "general_lateral": "8 frames per point, fast",
    "over_bound": "Variance over the Cramér–Rao bound",
    "over_reference": "Variance over that of the reference",
    "nees_pose": "pose",
    "nees_point": "point in the camera",
    "nees_point_in_world": "point in the world",
    "nees_rig": "rig",
}
_UNITS = {"rotation": "mrad", **dict.fromkeys(QUANTITIES[1:], "mm")}  # for figure 6, whose values are in rad and m
# Parts of the report on the rates: key, key of their numbers of frames, content, and title.
_LAWS = (
    ("drift_over_span", "span_frames", "span",
     {"rotation_relative": "rotation", "position_relative": "position", "theory": "theory"},
     "Drift of the bound by the span of a point, relative to 2 frames"),
    ("structure_over_window", "window_frames", "window", {"relative": "variance", "theory": "theory"},
     "Local structure of the bound by the window, relative to 1 frame"),
)  # fmt: skip
_OF_ESTIMATORS = (
    ("estimators_over_span", "span_frames", "variance_relative", "Variance by the span of a point, over 2 frames"),
    ("estimators_over_window", "window_frames", "variance_over_bound", "Variance by the window, over the bound"),
)


@record
class StudyTable:
    """A table: names of each row, and its values; `whole` is for files only, as it has too many rows to read.

    `best`: the best value in all cells; None if there is none.
    """

    title: str
    names: tuple[str, ...]
    columns: tuple[str, ...]
    rows: Sequence[tuple[tuple[str, ...], Sequence[Value]]]
    best: float | None = None
    whole: bool = False


def tables(report: Report) -> list[StudyTable]:
    """Return the tables of the content of results.json, without empty columns and rows."""
    found = [*_of_conditions(report), *_of_rates(report), *_of_figure6(report)]
    return [_without_empty(table) for table in found if table.rows]


def to_csv(report: Report) -> str:
    """Return CSV with each value and its interval on a separate line."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("table", "row", "column", "value", "low", "high"))
    for table in tables(report):
        for names, values in table.rows:
            for column, value in zip(table.columns, values, strict=True):
                if value is not None:
                    span = (value.value, value.low, value.high) if isinstance(value, Interval) else (value, "", "")
                    writer.writerow((table.title, ", ".join(names), column, *span))
    return text.getvalue()


def to_latex(report: Report) -> str:
    """Return the displayed tables as LaTeX, for the package booktabs."""
    parts = []
    for table in (table for table in tables(report) if not table.whole):
        head = " & ".join(map(_escaped, (*table.names, *table.columns)))
        lines = [" & ".join([*map(_escaped, names), *map(text_of, values)]) for names, values in table.rows]
        form = "l" * len(table.names) + "r" * len(table.columns)
        body = "".join(f"{line} \\\\\n" for line in lines)
        parts.append(
            f"% {table.title}\n\\begin{{tabular}}{{{form}}}\n\\toprule\n{head} \\\\\n\\midrule\n{body}\\bottomrule\n"
            "\\end{tabular}\n"
        )
    return "\n".join(parts)


def text_of(value: Value) -> str:
    """Return a number, with its 95 % interval if it has one."""
    if value is None:
        return "–"
    if isinstance(value, Interval):
        return f"{value.value:.2f} [{value.low:.2f}, {value.high:.2f}]"
    return number_text(value)


def in_words(key: str) -> str:
    """Return the name of a key of a report in words."""
    return _WORDS.get(key, key.replace("_", " "))


def _of_conditions(report: Report) -> Iterator[StudyTable]:
    """Yield a table for each kind of figure, with the conditions and their estimators as rows."""
    entries = [
        ((in_words(name), estimator), entry)
        for name, part in report.get("conditions", {}).items()
        for estimator, entry in part["estimators"].items()
    ]
    both = ("condition", "estimator")
    for kind in dict.fromkeys(key for _, entry in entries for key in entry if key.startswith("over_")):
        rows = [(names, [_value(of[kind].get(q)) for q in QUANTITIES]) for names, of in entries if kind in of]
        title = in_words(kind) + (f", {report['reference']}" if kind == "over_reference" else "")
        yield StudyTable(title, both, tuple(map(in_words, QUANTITIES)), rows, best=1.0)
    keys = [key for key in report.get("expected", {}) if key.startswith("nees_")]
    columns = tuple(f"{in_words(key)}, {report['expected'][key]:g} expected" for key in keys)
    rows = [(names, [_value(entry.get(key)) for key in keys]) for names, entry in entries]
    yield StudyTable("Normalised squared errors", both, columns, rows)
    lost = [(names, [100 * entry["lost_share"]]) for names, entry in entries if entry["lost_share"] > 0]
    yield StudyTable("Frames lost", both, ("%",), lost)


def _of_rates(report: Report) -> Iterator[StudyTable]:
    """Yield the tables of the paper's Table 1: exponents, laws over spans and windows, and results of estimators."""
    table = report.get("table", {})
    methods = tuple(dict.fromkeys(m for row in table.values() for m in row["exponents"]))
    rows = [
        (
            tuple(map(in_words, name.rsplit(" ", 1))),
            [*(_value(row["exponents"].get(method)) for method in methods), row["bound_exponent"]],
        )
        for name, row in table.items()
    ]
    title = "Growth of the variance: exponent of the frame number"
    yield StudyTable(title, ("run", "quantity"), (*methods, "bound"), rows)
    for key, frames, name, called, title in _LAWS:
        if part := report.get(key):
            rows = [
                ((counted(n, "frame"),), [_value(part[of][k]) for of in called]) for k, n in enumerate(part[frames])
            ]
            yield StudyTable(title, (name,), tuple(called.values()), rows)
    for key, frames, values, title in _OF_ESTIMATORS:
        if part := report.get(key):
            rows = [
                ((method, in_words(quantity)), list(map(_value, of)))
                for method, found in part[values].items()
                for quantity, of in found.items()
            ]
            columns = tuple(counted(n, "frame") for n in part[frames])
            yield StudyTable(title, ("estimator", "quantity"), columns, rows)


def curve_in_words(label: str) -> str:
    """Return the name of a curve of figure 6: cc_b4 is CC, anchored, b = 4."""
    kind, _, frames = label.partition("_b")
    return f"{KINDS[kind][1]}, b = {frames}" if kind in KINDS and frames else in_words(label)


def _of_figure6(report: Report) -> Iterator[StudyTable]:
    curves, frames = report.get("curves", {}), report.get("frames", [])
    columns = tuple(f"{in_words(q)}, {_UNITS[q]}" for q in QUANTITIES)

    def rows(which: Sequence[int]) -> list[tuple[tuple[str, ...], list[Value]]]:
        return [
            ((curve_in_words(label), str(frames[k])), [1e3 * of[q][k] for q in QUANTITIES])
            for label, of in curves.items()
            for k in which
        ]

    if curves:
        last = len(frames) - 1
        title = f"RMS errors at frame {frames[last]}"
        yield StudyTable(title, ("estimator",), columns, [(names[:1], values) for names, values in rows([last])])
        yield StudyTable("RMS errors", ("estimator", "frame"), columns, rows(range(len(frames))), whole=True)


def _value(found: Any) -> Value:
    """Return an interval from its form in results.json or a report."""
    if isinstance(found, Mapping):
        return Interval(found["value"], found["low"], found["high"])
    return found if isinstance(found, Interval | float | None) else float(found)


def _without_empty(table: StudyTable) -> StudyTable:
    kept = [k for k in range(len(table.columns)) if any(values[k] is not None for _, values in table.rows)]
    rows = [(names, [values[k] for k in kept]) for names, values in table.rows]
    rows = [(names, values) for names, values in rows if any(value is not None for value in values)]
    columns = tuple(table.columns[k] for k in kept)
    return StudyTable(table.title, table.names, columns, rows, table.best, table.whole)


def _escaped(text: str) -> str:
    for letter in "\\_%&#":
        text = text.replace(letter, f"\\{letter}")
    return text
