"""The page of a comparison: a table and four charts; details folded. One HTML file, beside report.json."""

from pathlib import Path
from typing import Any

from markupsafe import Markup

from ..files import json_bytes, write_whole
from ..types import Status
from . import charts
from .charts import Traces
from .methods import of_method
from .records import Comparison
from .tables import ACCURACY, FURTHER, TIME, Figure, LengthUnit, Name, table, unit_for
from .template import render
from .traces import trace_of

REPORT = ("report.json", "report.html")  # the files of a report
_RATIO = Figure("ratio", "position error", "over cross-frame")
_WITHOUT_TRUTH = (
    Figure("divergence_from_cross_frame_m", "away from cross-frame", "errors"),
    Figure("end_std_position_m", "σ at the end", "errors"),
    Figure("end_std_heading_deg", "σ of the heading", "°"),
    Figure("nis_over_dof", "NIS", "1 expected"),
)
_FURTHER = (
    *FURTHER,
    Figure("rpe_position_rms_m", "error per frame", "errors"),
    Figure("rpe_rotation_rms_deg", "rotation per frame", "°"),
    Figure("growth_exponent", "growth", "1 random, 2 bias"),
    Figure("nis_over_dof", "NIS", "1 expected"),
    Figure("reprojection_rms_px", "reprojection", "px"),
)


def write_report(comparison: Comparison, content: dict[str, Any], folder: Path) -> None:
    """Write report.json, the `content`, and report.html to a folder. Raises OutputError."""
    write_whole(folder / "report.json", json_bytes(content))
    write_whole(folder / "report.html", render_comparison(comparison, content).encode())


def render_comparison(c: Comparison, content: dict[str, Any]) -> str:
    """Render a comparison and its figures, the content of report.json, as HTML."""
    traces = _traces(c)
    ratios = content["error_over_cross_frame"]
    methods = [content["methods"][r.key] | {"ratio": ratios.get(r.key, {}).get("position")} for r in c.runs]
    looks = [of_method(run.name) for run in c.runs]
    names = [Name(look.name, run.failure, look.colour) for look, run in zip(looks, c.runs, strict=True)]
    away_m = content["divergence_from_cross_frame_m"].values()
    errors = unit_for(*(t.position_m for t in traces.values())) if traces else unit_for(list(away_m))
    local = unit_for([m["local_sigma_median_m"] or 0.0 for m in methods])
    units = {"errors": errors, "structure": local}
    more = []
    if traces:
        more = [charts.rotation_errors(traces), charts.growth(traces, errors), charts.structure(c.runs, local)]
    return render(
        "compare.html.j2",
        title=c.log,
        c=c,
        n=content,
        notes=_notes(c, content),
        path_m=float(next(iter(traces.values())).distance_m[-1]) if traces else methods[0]["path_length_m"],
        main=table((*(ACCURACY if traces else _WITHOUT_TRUTH), _RATIO, TIME), names, methods, units),
        further=table(_FURTHER, names, methods, units),
        charts=_charts(c, content, traces, errors),
        more_charts=more,
        lives=charts.lives(c.front),
        statuses=[(look.name, {s: r.count(s) for s in Status}) for look, r in zip(looks, c.runs, strict=True)],
        warnings=list(dict.fromkeys([*(content["health"].get("problems") or ()), *content["warnings"]])),
    )


def _traces(c: Comparison) -> Traces:
    """The traces of the methods that can be compared with ground truth."""
    if c.truth.poses is None:
        return {}
    found = ((run.name, trace_of(run.trajectory(), c.truth.poses)) for run in c.runs)
    return {name: t for name, t in found if t is not None}


def _charts(c: Comparison, content: dict[str, Any], traces: Traces, unit: LengthUnit) -> list[Markup]:
    """The four that are always shown."""
    gaps, path = c.front.gaps, charts.path({r.name: r.poses for r in c.runs if len(r)}, traces, loops=c.loops)
    if not traces:
        return [
            path,
            charts.structure(c.runs, unit),
            charts.apart(c.runs, gaps, unit),
            charts.innovations(c.runs, gaps),
        ]
    told = charts.ratios(content) if content["error_over_cross_frame"] else charts.rotation_errors(traces)
    return [charts.errors(traces, unit), told, charts.nees(traces, gaps), path]


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
    for run in c.runs:
        if lost := run.count(Status.LOST):
            notes.append(f"{of_method(run.name).name}: tracking was lost in {lost} of {len(run)} frames.")
    return notes
