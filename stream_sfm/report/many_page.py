"""The page of a comparison over many logs: a sentence, one table of ratios with intervals, one of the logs."""

from pathlib import Path
from typing import Any

from .methods import label
from .template import render

_REFERENCE = "cross-frame"


def render_many(content: dict[str, Any]) -> str:
    """Render the content of comparison.json as HTML."""
    methods = list(content["error_over_cross_frame"])
    return render(
        "many.html.j2",
        title=_subject(content),
        n=content,
        methods=methods,
        label=label,
        name=lambda sample: Path(sample["log"]).name,
        failed=[s for s in content["samples"] if s["failure"]],
        good=[s for s in content["samples"] if s["ratios"]],
        said=conclusion_of_many(content),
    )


def conclusion_of_many(content: dict[str, Any]) -> list[str]:
    """What all samples together say, one sentence per method."""
    overall = content["error_over_cross_frame"]
    good = [s for s in content["samples"] if s["ratios"]]
    if not overall:
        return ["No log could be compared; the reasons are listed below."]
    logs, starts = content["logs"], len(good)
    of = f"{logs} logs" if logs > 1 else f"{starts} starts of one log" if starts > 1 else "one log"
    if logs > 1 and starts > logs:
        of += f", {starts} starts"
    said = [f"Errors in {of}, over those of {_REFERENCE}."]
    level = [key for key, found in overall.items() if _level(found)]
    said += [_sentence(label(key), found) for key, found in overall.items() if key not in level]
    if level:
        said.append(f"Not told apart from {_REFERENCE} in position or rotation: {', '.join(map(label, level))}.")
    if logs == 1:
        said.append("This holds for this log; another one is another sample.")
    if content["interval_over"] == "frames" and starts > 1:
        said.append("The starts share frames, so that an interval is that of one run, however many there are.")
    if any(f[q]["ci95"] is None for f in overall.values() for q in f):
        said.append("Intervals need three samples.")
    return said


def _subject(content: dict[str, Any]) -> str:
    """What was compared, as a title."""
    names = list(dict.fromkeys(Path(s["log"]).name for s in content["samples"]))
    good = sum(bool(s["ratios"]) for s in content["samples"])
    runs = "1 run" if good == 1 else f"{good} runs"
    return f"{names[0] if len(names) == 1 else f'{len(names)} logs'}, {runs}"


def _level(found: dict[str, Any]) -> bool:
    """Whether neither quantity is told apart."""
    return all(f["ci95"] is not None and f["ci95"][0] <= 1 <= f["ci95"][1] for f in found.values())


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
