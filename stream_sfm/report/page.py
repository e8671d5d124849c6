"""The page of a comparison: a sentence, a table and four charts; details folded. One HTML file, beside report.json."""

from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from ..files import json_bytes, write_whole
from ..types import Status
from . import calibration_field, charts
from .charts import Traces
from .figures import ACCURACY, OF_COMPARISON, WITHOUT_TRUTH, table
from .lengths import LengthUnit, unit_for
from .methods import label, short, style
from .records import Comparison, RunRecord
from .template import render
from .traces import trace_of
from .verdict import verdict

REPORT = ("report.json", "report.html")  # the files of a report
_MOST_WARNINGS = 6  # shown; report.json has all


def write_report(comparison: Comparison, content: dict[str, Any], folder: Path) -> None:
    """Write report.json, the `content`, and report.html to a folder. Raises OutputError."""
    write_whole(folder / "report.json", json_bytes(content))
    write_whole(folder / "report.html", render_comparison(comparison, content).encode())


def render_comparison(c: Comparison, content: dict[str, Any]) -> str:
    """Render a comparison and its figures, the content of report.json, as HTML."""
    traces = _traces(c)
    methods = [content["methods"][run.key] for run in c.runs]
    errors, local = _units(c, traces, list(content["divergence_from_cross_frame_m"].values()))
    units = {"errors": errors, "structure": local}
    warnings = list(dict.fromkeys([*(content["health"].get("problems") or ()), *content["warnings"]]))
    return render(
        "compare.html.j2",
        title=c.log,
        c=c,
        n=content,
        label=label,
        style=style,
        verdict=verdict(content).sentences,
        notes=_notes(c, content),
        path_m=_path_length_m(traces, methods),
        main=table(ACCURACY if traces else WITHOUT_TRUTH, methods, units),
        further=table(OF_COMPARISON, methods, units).turned([label(r.name) for r in c.runs]),
        charts=_charts(c, content, traces, errors),
        more_charts=_more_charts(c, traces, errors, local),
        view=Markup("") if c.view is None else c.view.figure(),
        lives=charts.lives(c.front),
        timeline=_timeline(c.runs),
        statuses=list(Status),
        cells=calibration_field.cells(c.calibration) if c.calibration else [],
        warnings=warnings[:_MOST_WARNINGS],
        unseen=len(warnings[_MOST_WARNINGS:]),
    )


def _traces(c: Comparison) -> Traces:
    """The traces of the methods that can be compared with ground truth."""
    if c.truth.poses is None:
        return {}
    found = ((run.name, trace_of(run.trajectory(), c.truth.poses)) for run in c.runs if len(run) > 1)
    return {name: t for name, t in found if t is not None}


def _units(c: Comparison, traces: Traces, away_m: list[float]) -> tuple[LengthUnit, LengthUnit]:
    """The units of errors of position, without truth of distances between methods, and of errors of structure."""
    errors = unit_for(*(t.position_m for t in traces.values())) if traces else unit_for(away_m)
    sigmas = [run.column("sigma_local_m") for run in c.runs]
    return errors, unit_for(*([np.median(x[np.isfinite(x)])] for x in sigmas if np.isfinite(x).any()))


def _charts(c: Comparison, content: dict[str, Any], traces: Traces, unit: LengthUnit) -> list[Markup]:
    """The four that are always shown."""
    gaps, path = c.front.gaps, charts.path({r.name: r.poses for r in c.runs if len(r)}, traces, unit, loops=c.loops)
    if not traces:
        return [
            path,
            charts.structure(c.runs, unit),
            charts.apart(c.runs, gaps, unit),
            charts.innovations(c.runs, gaps),
        ]
    told = charts.ratios(content) if content["error_over_cross_frame"] else charts.rotation_errors(traces)
    return [charts.errors(traces, unit), told, charts.nees(traces, gaps), path]


def _more_charts(c: Comparison, traces: Traces, unit: LengthUnit, local: LengthUnit) -> list[Markup]:
    if not traces:
        return []
    structure = charts.structure(c.runs, local)
    return [charts.rotation_errors(traces), charts.growth(traces, unit), structure]


def _path_length_m(traces: Traces, methods: list[dict[str, Any]]) -> float | None:
    """The length of the true path, else of the first method's."""
    if traces:
        return float(next(iter(traces.values())).distance_m[-1])
    return next((m["path_length_m"] for m in methods), None)


def _notes(c: Comparison, content: dict[str, Any]) -> list[str]:
    """What a reader must know before looking at the figures."""
    notes = []
    frames, known = content["frames"], content["frames_with_ground_truth"]
    if c.truth.poses is not None and known < frames:
        if known:
            notes.append(f"Ground truth covers {known} of {frames} frames; all errors refer to these frames only.")
        else:
            notes.append("The log has ground truth, but none at the time stamp of any frame.")
    if c.truth.ignored:
        where = ", ".join(f"{first} to {end - 1}" for first, end in c.truth.ignored)
        notes.append(f"The ground truth of frames {where} was not used, as asked for.")
    if c.front.gaps:
        where = ", ".join(str(g) for g in c.front.gaps[:8])
        notes.append(f"Time gap before frame {where}{' …' if len(c.front.gaps) > 8 else ''}.")
    if not c.complete:
        notes.append(f"This report does not cover the whole log{': ' + c.warnings[-1] if c.warnings else ''}.")
    notes += [f"{label(r.name)}: {r.failure}." for r in c.runs if r.failure]
    for run in c.runs:
        if lost := run.count(Status.LOST):
            notes.append(f"{label(run.name)}: tracking was lost in {lost} of {len(run)} frames.")
    return notes


def _timeline(runs: list[RunRecord]) -> list[tuple[str, list[tuple[str, int, str]]]]:
    """The statuses of all methods, those with the same in one row: a name, and how many frames have which, and why."""
    groups: dict[tuple[Status, ...], list[RunRecord]] = {}
    for run in runs:
        groups.setdefault(tuple(run.statuses), []).append(run)
    rows = []
    for first, *others in groups.values():
        name = short(first.name) + (f" and {len(others)} more" if others else "")
        frames = groupby(zip(first.statuses, first.reasons, strict=True), key=lambda f: f[0])
        parts = [(status, [reason for _, reason in part]) for status, part in frames]
        rows.append((name, [(str(status), len(reasons), reasons[0]) for status, reasons in parts]))
    return rows
