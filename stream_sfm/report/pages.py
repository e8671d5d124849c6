"""The pages, one HTML file each: a comparison, finished runs against ground truth, a batch and each of its logs."""

from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from markupsafe import Markup

from ..camera.rig import masked_by
from ..errors import InputError
from ..evaluation.figures import (
    ABSOLUTE,
    ACCURACY,
    CONSISTENCY,
    ERRORS,
    LOCAL,
    OF_COMPARISON,
    SIGMA,
    STRUCTURE,
    TIME,
    Figure,
    LengthUnit,
    unit_for,
    units_of,
)
from ..logs.sources.pose_files import read_tum
from ..methods import REPLAYED
from ..system.files import json_bytes, write_whole
from ..system.wording import counted, in_a_row
from ..types import Status, Trajectory
from . import charts
from .charts import Traces, traces_of
from .inertia import inertial_rows
from .matches import matches
from .numbers import figures_of
from .records import OF_RUN, Comparison, RunRecord
from .svg import Chart, Series, draw
from .tables import Name, Table, of_method, of_runs, render, sigma_text, table, text_of

PAGE_OF_LOG = "report.html"  # in the folder of a log of a batch
REPORT = ("report.json", "report.html")  # the files of a report
_RATIO = (Figure("ratio", "position error", "over cross-frame"),)
_EXTENT = (Figure("frames", "frames"), Figure("path_length_m", "path", "m"))
_OF_BATCH = (*_EXTENT, *ACCURACY, *CONSISTENCY, *SIGMA, *ABSOLUTE, *LOCAL)
_UNFINISHED = (Figure("status", "status"), Figure("reason", "reason"))
_COSTS = (
    Figure("degraded", "degraded"),
    Figure("lost", "lost"),
    Figure("dropped", "dropped"),
    Figure("p50", "time", "ms, median"),
    Figure("p95", "time", "ms, 95 %"),
    Figure("frames_per_s", "frames/s"),
    Figure("cpu_ms", "CPU", "ms per frame"),
    Figure("peak_rss_mib", "memory", "MiB"),
)
_NOT_DONE = {"incomplete": "only partly read", "failed": "failed", "interrupted": "interrupted or not started"}


def write_report(comparison: Comparison, content: dict[str, Any], folder: Path) -> None:
    """Write report.json, the `content`, and report.html to a folder. Raises OutputError."""
    write_whole(folder / "report.json", json_bytes(content))
    write_whole(folder / "report.html", render_comparison(comparison, content).encode())


def render_comparison(c: Comparison, content: dict[str, Any]) -> str:
    """Render a comparison and its figures, the content of report.json, as HTML."""
    traces = traces_of((run.name, run.trajectory(), c.truth.poses, c.truth.std) for run in c.runs)
    ratios, of_spans = content["error_over_cross_frame"], content["drift"]
    methods = [content["methods"][r.key] | {"ratio": ratios.get(r.key, {}).get("position")} for r in c.runs]
    looks = [of_method(run.name) for run in c.runs]
    names = [Name(look.name, run.failure, look.colour) for look, run in zip(looks, c.runs, strict=True)]
    figures = figures_of(content)
    units = units_of(methods, figures) | {STRUCTURE: unit_for([m["local_sigma_median_m"] or 0.0 for m in methods])}
    errors, local, more = units[ERRORS], units[STRUCTURE], []
    if traces:
        more = [charts.errors(traces, 1, errors), charts.structure(c.runs, local)]
        more += charts.test_points(c.runs, c.truth.poses, local)
    return render(
        "compare.html.j2",
        title=c.log,
        c=c,
        n=content,
        notes=_notes(c, content),
        path_m=float(next(iter(traces.values())).distance_m[-1]) if traces else methods[0]["path_length_m"],
        of_spans=_spans(of_spans, names, c.runs),
        unseparated=any(of["position_from_halves"] for line in of_spans["table"] for of in line["methods"].values()),
        reference=of_method(of_spans["reference"]).name,
        drift_charts=[charts.drift(of_spans, kind, _unit_of_spans(of_spans)) for kind in (0, 1)],
        main=table((*figures, *_RATIO, *TIME), names, methods, units),
        further=table((*SIGMA, *OF_COMPARISON, *(of.figure for of in OF_RUN if of.further)), names, methods, units),
        charts=_charts(c, content, traces, errors),
        more_charts=more,
        lives=charts.lives(c.front),
        matches=matches(c.needles),
        masks=charts.masks(masked_by(c.config, c.rig)),
        statuses=[(look.name, {s: r.count(s) for s in Status}) for look, r in zip(looks, c.runs, strict=True)],
        warnings=list(dict.fromkeys([*(content["health"].get("problems") or ()), *content["warnings"]])),
    )


def _spans(content: dict[str, Any], names: Sequence[Name], runs: Sequence[RunRecord]) -> Table:
    """Return the errors by span in the section `drift` of report.json, with their ratios and factors of σ below."""
    lines, unit = content["table"], _unit_of_spans(content)
    rows = []
    for name, run in zip(names, runs, strict=True):
        of_run = [line["methods"].get(run.key) for line in lines]
        if any(of_run):
            rows.append((name, [(_span_cell(of, content, unit), "") for of in of_run]))
    return Table([(counted(line["frames"], "frame"), unit.name) for line in lines], rows)


def _span_cell(of: dict[str, Any] | None, content: dict[str, Any], unit: LengthUnit) -> str:
    if of is None:
        return text_of(None)
    ratio = of.get(f"position_over_{content['reference']}")
    below = [] if ratio is None else [text_of(ratio)]
    if of["position_from_halves"]:
        below.append("from halves" if ratio else "the truth cannot tell")
    below += filter(None, [sigma_text(of)])
    lines = Markup("").join(Markup("<small>{}</small>").format(line) for line in below)
    return text_of(of["position_rms_m"], unit.per_m) + lines


def _unit_of_spans(content: dict[str, Any]) -> LengthUnit:
    return unit_for([x["position_rms_m"] for line in content["table"] for x in line["methods"].values()])


def _charts(c: Comparison, content: dict[str, Any], traces: Traces, unit: LengthUnit) -> list[Markup]:
    """Return the charts that are always shown, beside those by span."""
    gaps, path = c.front.gaps, charts.path({r.name: r.poses for r in c.runs if len(r)}, traces, loops=c.loops)
    if not traces:
        further = charts.apart(c.runs, gaps, unit), charts.innovations(c.runs, gaps)
        return [path, charts.structure(c.runs, unit), *further]
    ratios = charts.ratios(content) if content["error_over_cross_frame"] else charts.errors(traces, 1, unit)
    return [charts.errors(traces, 0, unit), ratios, charts.nees(traces, gaps), path]


def _notes(c: Comparison, content: dict[str, Any]) -> list[str]:
    """Return what a reader must know before reading the figures."""
    notes = []
    frames, known = content["frames"], content["frames_with_ground_truth"]
    if c.truth.poses is not None and known < frames:
        if known:
            notes.append(f"Ground truth covers {known} of {frames} frames; all errors refer to these frames only.")
        else:
            notes.append("The log has ground truth, but none at the time stamp of any frame.")
    if c.truth.ignored:
        where = ", ".join(f"{first} to {end - 1}" for first, end in c.truth.ignored)
        notes.append(f"The ground truth of frames {where} was not used, as requested.")
    if c.front.gaps:
        where = ", ".join(str(g) for g in c.front.gaps[:8])
        notes.append(f"Time gap before frame {where}{' …' if len(c.front.gaps) > 8 else ''}.")
    if not c.complete:
        notes.append(f"This report does not cover the whole log{': ' + c.warnings[-1] if c.warnings else ''}.")
    own = [run for run in c.runs if run.name != REPLAYED]
    inertial = [of_method(run.name).name for run in own if run.inertial() is not None]
    if inertial and len(inertial) < len(own):
        notes.append(f"Inertial samples are used by {in_a_row(inertial)}, and by no other method here.")
    for run in c.runs:
        if lost := run.count(Status.LOST):
            notes.append(f"{of_method(run.name).name}: tracking was lost in {lost} of {len(run)} frames.")
    return notes


class Evaluated(NamedTuple):
    """A run with its figures against ground truth, as `evaluate` returns them."""

    name: str
    method: str
    figures: dict[str, Any]
    trajectory: Trajectory
    truth: Trajectory


def render_evaluation(runs: Sequence[Evaluated]) -> str:
    """Render runs as HTML; one with a single camera, whose lengths have no unit, appears in the table only."""
    scaled = [run for run in runs if "ate_rmse_m" in run.figures]
    traces = traces_of((run.name, run.trajectory, run.truth, tuple(run.figures["std_truth"])) for run in scaled)
    unit = unit_for(*(trace.position_m for trace in traces.values()))
    looks = of_runs([run.name for run in runs])
    names = [Name(run.name, of_method(run.method).name, looks(run.name).colour) for run in runs]
    figures = (Figure("frames_compared", "frames"), *ACCURACY, *CONSISTENCY, *SIGMA, *ABSOLUTE)
    return render(
        "evaluation.html.j2",
        title=counted(len(runs), "run"),
        accuracy=table(figures, names, [run.figures for run in runs], {"errors": unit}),
        charts=[
            charts.errors(traces, 0, unit, looks),
            charts.errors(traces, 1, unit, looks),
            charts.nees(traces, looks=looks),
            charts.path({r.name: r.trajectory.world_from_cam for r in scaled if len(r.trajectory)}, traces, looks),
        ],
    )


def render_batch(content: dict[str, Any], folder: Path) -> str:
    """Render the content of batch.json as HTML; the paths are read from the result folders of the logs."""
    estimated = [log for log in content["logs"] if log["summary"]]
    unfinished = [log for log in content["logs"] if log["status"] != "done"]
    names = [_name_of(log, f"{log['name']}/{PAGE_OF_LOG}") for log in estimated]
    rows = [_row_of(log["summary"]) for log in estimated]
    # Lengths are not comparable, as paths differ.
    compared = [f for f in _OF_BATCH[len(_EXTENT) :] if f.unit not in (ERRORS, STRUCTURE)]
    middle = [{f.key: _median([row.get(f.key) for row in rows]) for f in compared}] if len(rows) > 1 else []
    of_rows = [*names, *(Name("median") for _ in middle)]
    return render(
        "batch.html.j2",
        title=f"{counted(len(content['logs']), 'log')}, method {content['method']}",
        n=content,
        conclusion=conclusion(content),
        estimated=estimated,
        unfinished=table(_UNFINISHED, [Name(log["name"], log["log"]) for log in unfinished], unfinished, {}),
        accuracy=table(_OF_BATCH, of_rows, [*rows, *middle], units_of(rows, _OF_BATCH), compared=False),
        costs=table(_COSTS, names, [_costs_of(log["summary"]) for log in estimated], {}),
        statuses=[(log["name"], log["summary"]["statuses"]) for log in estimated],
        warnings=[(log["name"], warning) for log in estimated for warning in log["summary"]["warnings"]],
        frames=sum(row["frames"] for row in rows),
        path_m=sum(log["summary"]["path_length_m"] for log in estimated),
        paths=[_path(log["name"], folder / log["name"]) for log in estimated],
    )


def render_log(log: dict[str, Any], folder: Path) -> str:
    """Render one log of batch.json, which has been estimated, as HTML; its path is read from its result `folder`."""
    summary, row = log["summary"], _row_of(log["summary"])
    return render(
        "log.html.j2",
        title=log["name"],
        log=log,
        summary=summary,
        accuracy=table(_OF_BATCH, [_name_of(log)], [row], units_of([row], _OF_BATCH)),
        costs=table(_COSTS, [_name_of(log)], [_costs_of(summary)], {}),
        statuses=[(log["name"], summary["statuses"])],
        inertia=[] if not summary.get("imu") else list(inertial_rows(summary["imu"])),
        path=_path("Path seen from above", folder),
    )


def _name_of(log: dict[str, Any], href: str = "") -> Name:
    return Name(log["name"], "" if log["status"] == "done" else log["status"], href=href)


def _row_of(summary: dict[str, Any]) -> dict[str, Any]:
    """Return the figures of a summary as one flat level."""
    return summary | summary.get("ground_truth", {}) | {"frames": summary["frames"]["estimated"]}


def _costs_of(s: dict[str, Any]) -> dict[str, Any]:
    return s | s["frames"] | s["timing_ms"]["total"] | {"cpu_ms": 1000 * s["cpu_s"] / s["frames"]["estimated"]}


def conclusion(content: dict[str, Any]) -> str:
    """Return a sentence that says how many logs were completed, and what happened to the others."""
    counts = content["counts"]
    parts = [f"{counts.get('done', 0)} of {counted(len(content['logs']), 'log')} done"]
    parts += [f"{counts[status]} {words}" for status, words in _NOT_DONE.items() if counts.get(status)]
    if content["reused"]:
        parts.append(f"{content['reused']} reused from an earlier batch")
    return ", ".join(parts) + "."


def _median(values: list[float | None]) -> float | None:
    """Return the median of the known values of at least two logs."""
    known = [value for value in values if value is not None]
    return median(known) if len(known) > 1 else None


def _path(title: str, folder: Path) -> Markup:
    """Return the path of a run seen from above; empty if its file is missing."""
    try:
        t = read_tum(folder / "trajectory.tum").world_from_cam[:, :3, 3]
    except InputError:
        return Markup()
    return draw(Chart(title, "x, m (right)", "z, m (forward)", [Series(title, t[:, 0], t[:, 2], "c1")], path=True))
