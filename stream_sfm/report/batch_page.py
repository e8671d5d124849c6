"""The page of a batch: all its logs side by side, in one self-contained HTML file."""

from pathlib import Path
from statistics import median
from typing import Any

from markupsafe import Markup

from ..errors import InputError
from ..results.trajectory_files import read_tum
from ..types import Status
from .lengths import unit_for
from .svg import Chart, Series, draw
from .template import inline, template

STAGES = ("decode", "frontend", "estimator")
_PERCENT = ("final_drift_percent", "t_rel_percent", "r_rel_deg_per_100m", "scale_error_percent", "nees_pose_mean")


def render_batch(content: dict[str, Any], folder: Path) -> str:
    """Render the content of batch.json as HTML; the paths are read from the result folders of the logs."""
    estimated = [log for log in content["logs"] if log["summary"]]
    truths = [log["summary"]["ground_truth"] for log in estimated if "ground_truth" in log["summary"]]
    slowest = max((_stages_ms(log["summary"]) for log in estimated), default=0.0)
    return template("batch.html.j2").render(
        n=content,
        conclusion=conclusion(content),
        estimated=estimated,
        unfinished=[log for log in content["logs"] if log["status"] != "done"],
        medians={name: _median([truth[name] for truth in truths]) for name in _PERCENT} if truths else None,
        truths=len(truths),
        errors=unit_for([g.get(name) or 0.0 for g in truths for name in ("ate_rmse_aligned_m", "ate_rmse_m")]),
        local=unit_for([g.get("local_structure_median_m") or 0.0 for g in truths]),
        statuses=[status.value for status in Status],
        stages=STAGES,
        full_ms=slowest or 1.0,
        frames=sum(log["summary"]["frames"]["estimated"] for log in estimated),
        path_m=sum(log["summary"]["path_length_m"] for log in estimated),
        paths=[_path(log["name"], folder) for log in estimated],
        css=inline("page.css"),
        js=inline("page.js"),
    )


def conclusion(content: dict[str, Any]) -> str:
    """A sentence that says how many logs were completed, and what became of the others."""
    logs, counts = len(content["logs"]), content["counts"]
    parts = [f"{counts.get('done', 0)} of {logs} {'log' if logs == 1 else 'logs'} done"]
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


def _stages_ms(summary: dict[str, Any]) -> float:
    return sum(summary["timing_ms"][stage]["p50"] or 0.0 for stage in STAGES)


def _median(values: list[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return median(known) if known else None


def _path(name: str, folder: Path) -> Markup:
    """The path seen from above, empty where there is no file of it."""
    try:
        t = read_tum(folder / name / "trajectory.tum").world_from_cam[:, :3, 3]
    except InputError:
        return Markup()
    line = Series(name, t[:, 0], t[:, 2], "m-cross-frame")
    return draw(Chart(name, "x, m (right)", "z, m (forward)", [line], equal=True, height=300))
