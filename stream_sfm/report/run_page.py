"""The page of one run: where it went and how sure it is, its errors where the truth is known, statuses and time."""

from typing import Any

import numpy as np
from markupsafe import Markup

from .. import __version__
from ..types import Trajectory
from . import accuracy_charts, calibration_field, pictures
from .calibration_field import CalibrationError
from .consistency_charts import innovations
from .lengths import UNSCALED, LengthUnit, unit_for
from .methods import label, style
from .records import RunRecord
from .svg import SMOOTHED, Chart, Series, draw, smoothed
from .template import inline, template
from .traces import Trace, broken, trace_of

_EXPECTED_NEES = 6


def render_run(
    summary: dict[str, Any],
    run: RunRecord,
    truth: Trajectory | None = None,
    calibration: CalibrationError | None = None,
) -> str:
    """Render a run as HTML from its summary and record, and from its truth and the calibration's error, if known."""
    estimate = run.trajectory()
    found = None if truth is None else trace_of(estimate, truth)
    unit = UNSCALED if summary["unscaled"] else _errors_unit(estimate, found)
    length = "units" if summary["unscaled"] else "m"
    return template("run.html.j2").render(
        s=summary,
        version=__version__,
        name=summary["log"].rsplit("/", 1)[-1],
        unit=length,
        conclusion=conclusion_of_run(summary),
        paths=accuracy_charts.paths([run], {} if found is None else {run.name: found}, unit, length),
        errors=_errors(estimate, found, run.name, unit),
        errors_unit=unit,
        local_unit=unit_for([(summary.get("ground_truth") or {}).get("local_structure_median_m") or 0.0]),
        consistency=_consistency(summary),
        field=calibration_field.picture(calibration),
        work=_work(run),
        timeline=pictures.timeline([run], len(run), ()),
        label=label,
        css=inline("page.css"),
        js=inline("page.js"),
    )


def conclusion_of_run(summary: dict[str, Any]) -> str:
    """What the run shows, in a few plain sentences."""
    frames, truth = summary["frames"], summary.get("ground_truth")
    said = [f"{problem}." for problem in summary["problems"]]
    bad = [f"{frames[name]} {name}" for name in ("degraded", "lost", "dropped") if frames[name]]
    state = f"{frames['estimated'] - frames['backwards']} frames were estimated"
    said.append(f"{state}, {', '.join(bad)}." if bad else f"{state}, none of them degraded or lost.")
    if truth and truth.get("ate_rmse_aligned_m") is not None:
        said.append(
            f"The path is off by {_length(truth['ate_rmse_aligned_m'])} RMS after alignment, and ends "
            f"{truth['final_drift_percent']:.2g} % of its length from the truth."
            if truth["final_drift_percent"] is not None
            else f"The path is off by {_length(truth['ate_rmse_aligned_m'])} RMS after alignment."
        )
        if (nees := truth.get("nees_pose_mean")) is not None:
            times = float(np.sqrt(nees / _EXPECTED_NEES))
            said.append(f"Its errors are {times:.2g} times as large as the estimated σ (NEES {nees:.3g} for 6).")
    elif end := summary.get("end"):
        said.append(
            f"There is no ground truth; the position at the end has an estimated σ of {end['std_position_m']:.2g} m."
        )
    if not summary["complete"]:
        said.append("The run is not complete; the warnings say why.")
    return " ".join(said)


def _length(metres: float) -> str:
    unit = unit_for([metres])
    return f"{unit.per_m * metres:.3g} {unit.name}"


def _errors_unit(estimate: Trajectory, found: Trace | None) -> LengthUnit:
    """Of the errors of the position, or where they are not known of its σ."""
    sigma = None if estimate.cov_pose is None else np.sqrt(np.trace(estimate.cov_pose[:, :3, :3], axis1=1, axis2=2))
    return unit_for(sigma if found is None else found.position_m)


def _errors(estimate: Trajectory, found: Trace | None, method: str, length: LengthUnit) -> list[Markup]:
    """σ of position and rotation over the frames, beside the error where the truth is known."""
    frames = np.arange(len(estimate))
    charts = []
    cov = estimate.cov_pose
    for k, (what, part, scale) in enumerate((("Position", slice(0, 3), 1.0), ("Rotation", slice(3, 6), 57.29578))):
        series = []
        if found is not None:
            error = found.position_m if k == 0 else found.rotation_deg
            rows, y = broken(found.frames, error)
            series.append(Series("error", rows, y, style(method)))
        if cov is not None:
            sigma = scale * np.sqrt(np.maximum(np.trace(cov[:, part, part], axis1=1, axis2=2), 0))
            series.append(Series("estimated σ", frames, sigma, "m-truth"))
        unit = "degrees"
        if k == 0:
            series, unit = length.of(series), length.name
        title = f"{what} error and σ" if found is not None else f"Estimated σ of the {what.lower()}"
        note = "first poses aligned" if found is not None else "relative to the first frame"
        charts.append(draw(Chart(title, "frame", unit, series, note=note, zero=True)))
    return charts


def _consistency(summary: dict[str, Any]) -> tuple[list[int], list[tuple[str, dict[int, float]]]]:
    """Spans in frames, and rows of error over σ by span: against ground truth, and of halves against each other."""
    against = (summary.get("ground_truth") or {}).get("relative_consistency")
    found = {"against ground truth": against or []}
    found |= {f"halves of the {half}": rows for half, rows in (summary.get("self_test") or {}).items()}
    rows = [(name, {row["frames"]: row["factor"] for row in spans}) for name, spans in found.items() if spans]
    return sorted({span for _, factors in rows for span in factors}), rows


def _work(run: RunRecord) -> list[Markup]:
    """Counts of points, innovations, and time per frame."""
    n = np.arange(len(run))
    colours = {
        "tracked": "m-cross-frame",
        "used": "m-cross-frame-wc",
        "new": "m-ekf",
        "rejected": "m-frame-to-frame",
    }
    points = [Series(name, n, run.column(name), colour) for name, colour in colours.items()]
    stages = {"decode": "m-truth", "frontend": "m-cross-frame-wc", "estimator": "m-ekf", "total": "m-cross-frame"}
    times = [Series(name, n, smoothed(run.column(name)), colour) for name, colour in stages.items()]
    nis = [Series("NIS / dof", n, smoothed(run.nis_over_dof), "m-cross-frame")]
    return [
        draw(Chart("Points", "frame", "points", points, zero=True)),
        draw(Chart("Time per frame", "frame", "ms", times, note=SMOOTHED, zero=True)),
        innovations(nis),
    ]
