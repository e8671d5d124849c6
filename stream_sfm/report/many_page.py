"""The page of a comparison over many logs: a sentence, one table of ratios with intervals, one of the logs."""

from pathlib import Path
from typing import Any

from .methods import label
from .template import inline, template

_REFERENCE = "cross-frame"


def render_many(content: dict[str, Any]) -> str:
    """Render the content of comparison.json as HTML."""
    methods = list(content["error_over_cross_frame"])
    return template("many.html.j2").render(
        n=content,
        methods=methods,
        label=lambda key: label(key.replace("_", "-")),
        name=lambda sample: Path(sample["log"]).name,
        failed=[s for s in content["samples"] if s["failure"]],
        good=[s for s in content["samples"] if s["ratios"]],
        said=conclusion_of_many(content),
        css=inline("page.css"),
    )


def conclusion_of_many(content: dict[str, Any]) -> list[str]:
    """What all samples together say, one sentence per method."""
    overall = content["error_over_cross_frame"]
    good = [s for s in content["samples"] if s["ratios"]]
    if not overall:
        return ["No log could be compared; the reasons are listed below."]
    logs, starts = content["logs"], len(good)
    of = f"{logs} logs" if logs > 1 else f"{starts} starts of one log"
    if logs > 1 and starts > logs:
        of += f", {starts} starts"
    said = [f"Errors over {of}, over those of {_REFERENCE}."]
    for key, found in overall.items():
        said.append(_sentence(label(key.replace("_", "-")), found))
    if logs == 1:
        said.append("All of this holds for this log: its starts share its scene and its motion.")
    if content["interval_over"] == "frames" and starts > 1:
        said.append("The starts share frames, so that an interval is that of one run, however many there are.")
    if any(f[q]["ci95"] is None for f in overall.values() for q in f):
        said.append("Intervals need three samples.")
    return said


def _sentence(name: str, found: dict[str, Any]) -> str:
    parts = []
    for quantity, f in found.items():
        if f["ci95"] is None:
            parts.append(f"{quantity} ×{f['value']:.2f}")
            continue
        low, high = f["ci95"]
        told = "larger" if low > 1 else "smaller" if high < 1 else "not told apart"
        parts.append(f"{quantity} {told} (×{f['value']:.2f} [{low:.2f}, {high:.2f}])")
    return f"{name[:1].upper()}{name[1:]}: {', '.join(parts)}."
