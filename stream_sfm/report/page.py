"""The drift report: one self-contained HTML file, and report.json beside it."""

from pathlib import Path
from typing import Any

import numpy as np

from ..files import json_bytes, write_whole
from ..types import Status
from . import accuracy_charts, calibration_field, consistency_charts, pictures
from .accuracy_charts import Traces
from .conclusion import conclusion
from .lengths import LengthUnit, unit_for
from .methods import label, style
from .records import Comparison
from .template import inline, template
from .traces import closure, trace

REPORT = ("report.json", "report.html")  # the files of a report


def write_report(comparison: Comparison, content: dict[str, Any], folder: Path) -> None:
    """Write report.json, the `content`, and report.html to a folder. Raises OutputError."""
    write_whole(folder / "report.json", json_bytes(content))
    write_whole(folder / "report.html", render(comparison, content).encode())


def render(c: Comparison, content: dict[str, Any]) -> str:
    """Render a comparison and its figures, the content of report.json, as HTML."""
    traces = _traces(c)
    truth = bool(traces)
    methods = content["methods"]
    returned = any(m["there_and_back"] for m in methods.values())
    log_check = {"warnings": [], "problems": [], "topics": []} | content["health"]
    split = next((m for m in methods.values() if m["straight"] or m["turning"]), None)
    errors, local = _units(c, traces)
    lengths = next((m["segment_lengths_m"] for m in methods.values() if m["segment_lengths_m"]), None)
    return template("page.html.j2").render(
        c=c,
        n=content,
        css=inline("page.css"),
        js=inline("page.js"),
        label=label,
        style=style,
        truth=truth,
        returned=returned,
        conclusion=conclusion(content),
        notes=_notes(c, content),
        sections=_sections(truth, returned, c.calibration is not None),
        path_m=_path_length_m(traces, methods),
        lengths=_lengths(lengths),
        grown=any(m["growth_exponent"] is not None for m in methods.values()),
        banded=any(t.sigma is not None for t in traces.values()),
        turns=[(split[k] or {"spans": 0})["spans"] for k in ("straight", "turning")] if split else None,
        depth=any(r.depth_rows for r in c.runs),
        errors=errors,
        local=local,
        charts=_charts(c, traces, errors, local),
        images={
            "stereo": pictures.stereo_frames(c.front),
            "needles": pictures.needles(c.front),
            "lives": pictures.lives(c.front),
            "timeline": pictures.timeline(c.runs, len(c.front), c.front.gaps),
            "calibration": calibration_field.picture(c.calibration),
        },
        stages=[*content["timing_ms"].items(), *((label(r.name), methods[r.key]["estimator_ms"]) for r in c.runs)],
        log_check=log_check,
        all_warnings=list(dict.fromkeys([*log_check["warnings"], *content["warnings"]])),
        log_check_facts=_log_check_facts(log_check),
    )


def _traces(c: Comparison) -> Traces:
    """The traces of the methods that can be compared with ground truth."""
    if c.truth.poses is None:
        return {}
    found = ((run.name, trace(run, c.truth.poses)) for run in c.runs if len(run) > 1)
    return {name: t for name, t in found if t is not None}


def _units(c: Comparison, traces: Traces) -> tuple[LengthUnit, LengthUnit]:
    """The units of errors of position, and of errors of the local structure."""
    closures = [found.position_m for run in c.runs if (found := closure(run)) is not None]
    errors = unit_for(*([t.position_m for t in traces.values()] or closures))
    sigmas = [run.column("sigma_local_m") for run in c.runs]
    return errors, unit_for(*([np.median(x[np.isfinite(x)])] for x in sigmas if np.isfinite(x).any()))


def _charts(c: Comparison, traces: Traces, unit: LengthUnit, local: LengthUnit) -> dict[str, Any]:
    gaps = c.front.gaps
    return {
        "paths": accuracy_charts.paths(c.runs, traces, unit),
        "errors": accuracy_charts.errors(traces, gaps, unit),
        "drift": accuracy_charts.drift(traces, unit),
        "axes": [(name, accuracy_charts.axes(t, name, unit)) for name, t in traces.items()],
        "consistency": consistency_charts.consistency(traces, c.runs, gaps),
        "agreement": consistency_charts.agreement(c.runs, gaps, unit),
        "structure": consistency_charts.structure(c, local),
        "work": consistency_charts.work(c),
    }


def _sections(truth: bool, returned: bool, calibration: bool) -> list[tuple[str, str]]:
    """Anchor and title of each section."""
    accuracy = [("errors", "Error"), ("drift", "Drift"), ("axes", "Axes")] if truth else []
    return [
        ("summary", "Summary"),
        ("path", "Path"),
        *accuracy,
        ("consistency", "Consistency"),
        ("agreement", "There and back" if returned else "Agreement"),
        ("structure", "Structure"),
        *([("calibration", "Calibration")] if calibration else []),
        ("images", "Images"),
        ("work", "Status and time"),
        ("log-check", "Log check"),
        ("configuration", "Configuration"),
    ]


def _path_length_m(traces: Traces, methods: dict[str, Any]) -> float | None:
    """The length of the true path, else of the first method's."""
    if traces:
        return float(next(iter(traces.values())).distance_m[-1])
    return next((m["path_length_m"] for m in methods.values()), None)


def _notes(c: Comparison, content: dict[str, Any]) -> list[str]:
    """What a reader must know before looking at the figures."""
    notes = []
    frames, known = content["frames"], content["frames_with_ground_truth"]
    if frames < 24:
        notes.append(f"The log has only {frames} frames: growth, segment errors and intervals are not meaningful.")
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


def _lengths(lengths: list[float] | None) -> str:
    if not lengths:
        return "no length (the path is too short)"
    return ", ".join(f"{x:.3g}" for x in lengths) + " m"


def _log_check_facts(log_check: dict[str, Any]) -> list[tuple[str, str]]:
    facts = []
    for section in ("pair", "frames", "rig", "calibration_check"):
        for name, value in (log_check.get(section) or {}).items():
            if name in ("gaps", "right_from_left") or value is None:
                continue
            text = f"{value:.5g}" if isinstance(value, float) else str(value)
            facts.append((name.replace("_", " "), text))
    return facts
