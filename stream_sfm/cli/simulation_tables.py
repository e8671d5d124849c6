"""The results of the simulation studies as tables."""

from collections.abc import Iterator, Sequence
from typing import Any

from .tables import print_table

_PIPED_WIDTH = 160  # columns: the table of rates has six, some of them sentences
Table = tuple[str, Sequence[str], Sequence[Sequence[str]]]  # title, headings, rows
_QUANTITIES = ("rotation", "position", "global_structure", "local_structure")


def print_tables(experiment: str, report: dict[str, Any]) -> None:
    """Print the tables of one experiment."""
    for title, headings, rows in _tables(experiment, report):
        words = len(headings) if headings[0] == "sequence" else 1
        print_table(rows, headings, title=title, width=_PIPED_WIDTH, text_columns=words)


def _tables(experiment: str, report: dict[str, Any]) -> Iterator[Table]:
    if experiment == "rates":
        yield _growth(report)
        yield _drift_over_span(report["drift_over_span"])
        yield _structure_over_window(report["structure_over_window"])
        over_span, over_window = report["estimators_over_span"], report["estimators_over_window"]
        title = f"Variance of the estimators by track length L, over that at L = 2, {report['trials']} trials"
        yield _of_estimators(title, "L", over_span["span_frames"], over_span["variance_relative"])
        title = f"Variance of the estimators over the bound by window b, L = 8, {report['trials']} trials"
        yield _of_estimators(title, "b", over_window["window_frames"], over_window["variance_over_bound"])
    elif experiment == "figure6":
        yield _errors_at_the_end(report)
    else:
        yield from _of_conditions(report)


def _errors_at_the_end(report: dict[str, Any]) -> Table:
    rows = [
        [label, f"{1e3 * c['rotation'][-1]:.2f}", *(f"{1e3 * c[q][-1]:.1f}" for q in _QUANTITIES[1:])]
        for label, c in report["curves"].items()
    ]
    columns = ("rotation, mrad", "position, mm", "global structure, mm", "local structure, mm")
    title = f"RMS errors at frame {report['frames'][-1]}, {report['trials']} trials"
    return (title, ["estimator", *columns], rows)


def _of_conditions(report: dict[str, Any]) -> Iterator[Table]:
    """Of each condition, a table for each kind of figures: one row per estimator, with its intervals."""
    expected = (f"{k.removeprefix('nees_')} {v:.0f}" for k, v in report.get("expected", {}).items() if "nees" in k)
    meanings = {
        "": f"mean normalised squared error (expected: {', '.join(expected).replace('_', ' ')})",
        "over_bound": "variance relative to the Cramér–Rao bound",
        "over_reference": f"variance relative to {report.get('reference')}, paired",
    }
    for condition, part in report["conditions"].items():
        for key, meaning in meanings.items():
            entries = {name: entry.get(key, {}) if key else entry for name, entry in part["estimators"].items()}
            columns = {k: None for entry in entries.values() for k, v in entry.items() if _is_interval(v)}
            rows = [
                [name, *(_interval(entry[k]) if k in entry else "" for k in columns)]
                for name, entry in entries.items()
                if entry
            ]
            if columns:
                title = f"{condition.replace('_', ' ')}: {meaning}; {part['trials']} trials"
                yield (title, ["estimator", *(k.replace("_", " ") for k in columns)], rows)


def _growth(report: dict[str, Any]) -> Table:
    rows = [
        [
            row["title"],
            row["quantity"].replace("_", " "),
            f"{row['frames'][0]}–{row['frames'][1]}",
            row["paper"],
            *("n^ " + _interval(found) for found in row["exponents"].values()),
            f"n^ {row['bound_exponent']:.2f}; {row['theory']}",
        ]
        for row in report["table"]
    ]
    estimators = [f"measured: {name}" for name in report["table"][0]["exponents"]]
    columns = ["sequence", "variance of", "frames", "paper", *estimators, "exact theory (exponent of the bound)"]
    return (f"Table 1: growth of error variance, {report['trials']} trials", columns, rows)


def _drift_over_span(spans: dict[str, Any]) -> Table:
    names = ("span_frames", "rotation_relative", "position_relative", "theory")
    rows = [[str(n), *(f"{v:.4f}" for v in values)] for n, *values in zip(*(spans[k] for k in names), strict=True)]
    title = f"Drift rate against track length L (bound); exponent {_interval(spans['exponent_rotation'])}"
    return (title, ["L", "rotation", "position", "3/(L²−1)"], rows)


def _structure_over_window(windows: dict[str, Any]) -> Table:
    names = ("window_frames", "relative", "theory")
    rows = [[str(b), _interval(v), f"{t:.3f}"] for b, v, t in zip(*(windows[k] for k in names), strict=True)]
    title = "Local structure against window length b (bound), L = 16"
    return (title, ["b", "variance relative to one view", "(1/L)(H_b + (L−b)/b)"], rows)


def _of_estimators(
    title: str, heading: str, values: Sequence[int], found: dict[str, dict[str, list[dict[str, float]]]]
) -> Table:
    """One row per estimator and value, one column per quantity."""
    rows = [
        [name, str(value), *(_interval(of_quantity[q][k]) for q in _QUANTITIES)]
        for name, of_quantity in found.items()
        for k, value in enumerate(values)
    ]
    return (title, ["estimator", heading, *(q.replace("_", " ") for q in _QUANTITIES)], rows)


def _is_interval(v: Any) -> bool:
    return isinstance(v, dict) and "low" in v


def _interval(v: dict[str, float]) -> str:
    return f"{v['value']:.2f} [{v['low']:.2f}, {v['high']:.2f}]"
