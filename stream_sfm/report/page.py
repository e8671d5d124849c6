"""The page: one HTML file with everything inside, and report.json beside it."""

from pathlib import Path
from typing import Any

from ..files import json_bytes, write_whole
from . import charts, pictures
from .numbers import numbers, verdict
from .records import Comparison
from .template import inline, template
from .traces import trace


def write_report(comparison: Comparison, folder: Path) -> dict[str, Any]:
    """Write report.html and report.json to the folder; returns the content of the latter. Raises OutputError."""
    content = numbers(comparison)
    write_whole(folder / "report.json", json_bytes(content))
    write_whole(folder / "report.html", render(comparison, content).encode())
    return content


def render(c: Comparison, content: dict[str, Any]) -> str:
    """The HTML of a comparison and its figures."""
    traces = {}
    if c.truth is not None:
        whole = [r for r in c.runs if len(r.poses) > 1]
        traces = {r.name: t for r in whole if (t := trace(r, c.truth)) is not None}
    truth = bool(traces)
    marks = c.front.gaps
    methods = content["methods"]
    returned = any(m["there_and_back"] for m in methods.values())
    health = {"warnings": [], "problems": [], "topics": []} | content["health"]
    split = next((m for m in methods.values() if m["straight"] or m["turning"]), None)
    lengths = next((m["segment_lengths_m"] for m in methods.values() if m["segment_lengths_m"]), None)
    path_m = next(iter(traces.values())).distance_m[-1] if truth else None
    if path_m is None:
        path_m = next((m["path_length_m"] for m in methods.values()), None)
    sections = [("summary", "Summary"), ("path", "Path")]
    if truth:
        sections += [("errors", "Error"), ("drift", "Drift"), ("axes", "Axes")]
    sections += [
        ("consistency", "Consistency"),
        ("agreement", "There and back" if returned else "Agreement"),
        ("structure", "Structure"),
        ("images", "Pictures"),
        ("work", "Status and time"),
        ("health", "Log health"),
        ("configuration", "Configuration"),
    ]
    return template("page.html.j2").render(
        c=c,
        n=content,
        css=inline("page.css"),
        js=inline("page.js"),
        label=charts.label,
        style=charts.style,
        truth=truth,
        returned=returned,
        verdict=verdict(content, truth),
        notes=_notes(c, content),
        sections=sections,
        path_m=path_m,
        lengths=_lengths(lengths),
        grown=any(m["growth_exponent"] is not None for m in methods.values()),
        banded=any(t.sigma is not None for t in traces.values()),
        turns=[(split[k] or {"spans": 0})["spans"] for k in ("straight", "turning")] if split else None,
        depth=any(r.depth_rows for r in c.runs),
        charts={
            "paths": charts.paths(c.runs, traces),
            "errors": charts.errors(traces, marks),
            "drift": charts.drift(traces),
            "axes": [(name, charts.axes(t, name)) for name, t in traces.items()],
            "consistency": charts.consistency(traces, c.runs, marks),
            "without": charts.without_truth(c.runs, marks),
            "structure": charts.structure(c),
            "work": charts.work(c),
        },
        pictures={
            "stereo": pictures.stereo_frames(c.front),
            "needles": pictures.needles(c.front),
            "lives": pictures.lives(c.front),
            "timeline": pictures.timeline(c),
        },
        stages=[
            *content["timing_ms"].items(),
            *((charts.label(r.name), methods[r.key]["estimator_ms"]) for r in c.runs),
        ],
        health=health,
        all_warnings=list(dict.fromkeys([*health["warnings"], *content["warnings"]])),
        health_facts=_health_facts(health),
    )


def _notes(c: Comparison, content: dict[str, Any]) -> list[str]:
    """What a reader must know before the figures."""
    notes = []
    frames, known = content["frames"], content["frames_with_ground_truth"]
    if frames < 24:
        notes.append(f"The log has {frames} frames: too few for growth, segments and intervals to mean anything.")
    if c.truth is not None and known < frames:
        if known:
            notes.append(f"Ground truth covers {known} of {frames} frames; errors are those of these frames alone.")
        else:
            notes.append("The log has ground truth, but at the stamp of no frame.")
    if c.front.gaps:
        where = ", ".join(str(g) for g in c.front.gaps[:8])
        notes.append(f"Time jumps before frame {where}{' …' if len(c.front.gaps) > 8 else ''}.")
    if not c.complete:
        notes.append(f"Not all of the log is in this report{': ' + c.warnings[-1] if c.warnings else ''}.")
    notes += [f"{charts.label(r.name)}: {r.failure}." for r in c.runs if r.failure]
    for run in c.runs:
        lost = run.statuses.count("lost")
        if lost:
            notes.append(f"{charts.label(run.name)}: tracking was lost in {lost} of {len(run.statuses)} frames.")
    return notes


def _lengths(lengths: list[float] | None) -> str:
    if not lengths:
        return "no length: the path is too short"
    return ", ".join(f"{x:.3g}" for x in lengths) + " m"


def _health_facts(health: dict[str, Any]) -> list[tuple[str, str]]:
    facts = []
    for section in ("pair", "frames", "rig", "calibration_check"):
        for name, value in (health.get(section) or {}).items():
            if name in ("gaps", "right_from_left") or value is None:
                continue
            text = f"{value:.5g}" if isinstance(value, float) else str(value)
            facts.append((name.replace("_", " "), text))
    return facts
