"""The page of a batch: all its logs side by side, in one self-contained HTML file."""

from pathlib import Path
from statistics import median
from typing import Any

from markupsafe import Markup

from ..errors import InputError
from ..sources.pose_files import read_tum
from ..types import Status
from ..wording import counted
from .figures import ACCURACY, FURTHER, table
from .lengths import unit_for
from .svg import Chart, Series, draw
from .template import render

_FIGURES = (*ACCURACY, *FURTHER)


def render_batch(content: dict[str, Any], folder: Path) -> str:
    """Render the content of batch.json as HTML; the paths are read from the result folders of the logs."""
    estimated = [log for log in content["logs"] if log["summary"]]
    truths = [log["summary"]["ground_truth"] for log in estimated if "ground_truth" in log["summary"]]
    units = {
        "errors": unit_for([g.get(name) or 0.0 for g in truths for name in ("ate_rmse_aligned_m", "ate_rmse_m")]),
        "structure": unit_for([g.get("local_structure_median_m") or 0.0 for g in truths]),
    }
    return render(
        "batch.html.j2",
        title=f"{counted(len(content['logs']), 'log')}, method {content['method']}",
        n=content,
        conclusion=conclusion(content),
        estimated=estimated,
        unfinished=[log for log in content["logs"] if log["status"] != "done"],
        accuracy=table(_FIGURES, [log["summary"].get("ground_truth", {}) for log in estimated], units),
        medians=_medians(truths) if len(truths) > 1 else None,
        truths=len(truths),
        statuses=[status.value for status in Status],
        frames=sum(log["summary"]["frames"]["estimated"] for log in estimated),
        path_m=sum(log["summary"]["path_length_m"] for log in estimated),
        paths=[_path(log["name"], folder) for log in estimated],
    )


def conclusion(content: dict[str, Any]) -> str:
    """A sentence that says how many logs were completed, and what became of the others."""
    counts = content["counts"]
    parts = [f"{counts.get('done', 0)} of {counted(len(content['logs']), 'log')} done"]
    for status, words in (
        ("incomplete", "only partly read"),
        ("failed", "failed"),
        ("interrupted", "interrupted or not started"),
    ):
        if counts.get(status):
            parts.append(f"{counts[status]} {words}")
    if content["reused"]:
        parts.append(f"{content['reused']} reused from an earlier batch")
    return ", ".join(parts) + "."


def _medians(truths: list[dict[str, Any]]) -> list[float | None]:
    """Of the figures of all logs, where they compare: lengths do not, as paths differ."""
    known = [[truth[f.key] for truth in truths if truth.get(f.key) is not None] for f in _FIGURES]
    lengths = ("errors", "structure")
    return [
        median(values) if len(values) > 1 and f.unit not in lengths else None
        for f, values in zip(_FIGURES, known, strict=True)
    ]


def _path(name: str, folder: Path) -> Markup:
    """The path seen from above, empty where there is no file of it."""
    try:
        t = read_tum(folder / name / "trajectory.tum").world_from_cam[:, :3, 3]
    except InputError:
        return Markup()
    line = Series(name, t[:, 0], t[:, 2], "m-cross-frame")
    return draw(Chart(name, "x, m (right)", "z, m (forward)", [line], path=True))
