"""The page of a batch: all its logs side by side, in one self-contained HTML file."""

from pathlib import Path
from statistics import median
from typing import Any

from markupsafe import Markup

from ..errors import InputError
from ..sources.pose_files import read_tum
from ..wording import counted
from .svg import Chart, Series, draw
from .tables import ACCURACY, FRAMES, FURTHER, Figure, Name, table, unit_for
from .template import render

_ACCURACY = (FRAMES, Figure("path_length_m", "path", "m"), *ACCURACY, *FURTHER)
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
_WORDS = {
    "done": "",
    "incomplete": "only partly read",
    "failed": "failed",
    "interrupted": "interrupted or not started",
}


def render_batch(content: dict[str, Any], folder: Path) -> str:
    """Render the content of batch.json as HTML; the paths are read from the result folders of the logs."""
    estimated = [log for log in content["logs"] if log["summary"]]
    unfinished = [log for log in content["logs"] if log["status"] != "done"]
    summaries = [log["summary"] for log in estimated]
    names = [
        Name(log["name"], "" if log["status"] == "done" else log["status"], href=log["name"]) for log in estimated
    ]
    rows = [s.get("ground_truth", {}) | {"frames": s["frames"]["estimated"]} for s in summaries]
    rows = [row | {"path_length_m": s["path_length_m"]} for row, s in zip(rows, summaries, strict=True)]
    # Lengths do not compare, as paths differ.
    compared = [f for f in _ACCURACY[2:] if f.unit not in ("errors", "structure")]
    middle = [{f.key: _median([row.get(f.key) for row in rows]) for f in compared}] if len(rows) > 1 else []
    units = {
        "errors": unit_for([row.get(key) or 0.0 for row in rows for key in ("ate_rmse_aligned_m", "ate_rmse_m")]),
        "structure": unit_for([row.get("local_structure_median_m") or 0.0 for row in rows]),
    }
    costs = [
        s | s["frames"] | s["timing_ms"]["total"] | {"cpu_ms": 1000 * s["cpu_s"] / s["frames"]["estimated"]}
        for s in summaries
    ]
    return render(
        "batch.html.j2",
        title=f"{counted(len(content['logs']), 'log')}, method {content['method']}",
        n=content,
        conclusion=conclusion(content),
        estimated=estimated,
        unfinished=table(
            (Figure("status", "status"), Figure("reason", "reason")),
            [Name(log["name"], log["log"]) for log in unfinished],
            unfinished,
            {},
        ),
        accuracy=table(_ACCURACY, [*names, *(Name("median") for _ in middle)], [*rows, *middle], units),
        costs=table(_COSTS, names, costs, {}),
        statuses=[(log["name"], log["summary"]["statuses"]) for log in estimated],
        warnings=[(log["name"], warning) for log in estimated for warning in log["summary"]["warnings"]],
        frames=sum(s["frames"]["estimated"] for s in summaries),
        path_m=sum(s["path_length_m"] for s in summaries),
        paths=[_path(log["name"], folder) for log in estimated],
    )


def conclusion(content: dict[str, Any]) -> str:
    """A sentence that says how many logs were completed, and what became of the others."""
    counts = content["counts"]
    parts = [f"{counts.get('done', 0)} of {counted(len(content['logs']), 'log')} done"]
    parts += [f"{counts[status]} {words}" for status, words in _WORDS.items() if words and counts.get(status)]
    if content["reused"]:
        parts.append(f"{content['reused']} reused from an earlier batch")
    return ", ".join(parts) + "."


def _median(values: list[float | None]) -> float | None:
    """The median of what is known, of two logs at least."""
    known = [value for value in values if value is not None]
    return median(known) if len(known) > 1 else None


def _path(name: str, folder: Path) -> Markup:
    """The path seen from above, empty where there is no file of it."""
    try:
        t = read_tum(folder / name / "trajectory.tum").world_from_cam[:, :3, 3]
    except InputError:
        return Markup()
    return draw(Chart(name, "x, m (right)", "z, m (forward)", [Series(name, t[:, 0], t[:, 2], "c1")], path=True))
