"""The page of one run: where it went and how sure it is, its errors where the truth is known, statuses and time."""

from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup

from .. import __version__
from ..geometry.se3 import Array
from ..types import Status, Trajectory
from . import calibration_field, pictures
from .consistency_charts import innovations
from .lengths import UNSCALED, LengthUnit, unit_for
from .methods import label, style
from .records import CalibrationError, MethodRun
from .svg import SMOOTHED, Chart, Series, draw, smoothed
from .template import inline, template
from .traces import Trace, broken, trace_of

_TUBE_SIGMAS = 3
_TUBE_SHARE = 0.02  # of the path's extent: a tube narrower than this is drawn wider by a round factor, and says so
_EXPECTED_NEES = 6


class RunColumns(NamedTuple):
    """What a run remembers of each frame: poses with covariances, statuses, counts of points, NIS per degree of
    freedom, and milliseconds by stage."""

    trajectory: Trajectory
    statuses: list[Status]
    counts: dict[str, Array]
    nis_over_dof: Array
    times_ms: dict[str, Array]


def render_run(
    summary: dict[str, Any],
    columns: RunColumns,
    truth: Trajectory | None,
    calibration: CalibrationError | None = None,
) -> str:
    """Render a run as HTML from its summary and columns, and from its truth and the calibration's error, if known."""
    run = MethodRun(summary["method"], statuses=[str(s) for s in columns.statuses])
    unit = "units" if summary["unscaled"] else "m"
    found = None if truth is None else trace_of(columns.trajectory, truth)
    errors_unit = UNSCALED if summary["unscaled"] else _errors_unit(columns.trajectory, found)
    return template("run.html.j2").render(
        s=summary,
        version=__version__,
        name=summary["log"].rsplit("/", 1)[-1],
        unit=unit,
        conclusion=conclusion_of_run(summary),
        paths=_paths(columns.trajectory, found, summary["method"], unit),
        errors=_errors(columns.trajectory, found, summary["method"], errors_unit),
        errors_unit=errors_unit,
        local_unit=unit_for([(summary.get("ground_truth") or {}).get("local_structure_median_m") or 0.0]),
        consistency=_consistency(summary),
        field=calibration_field.picture(calibration),
        work=_work(columns),
        timeline=pictures.timeline([run], len(columns.statuses), ()),
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


def _paths(estimate: Trajectory, found: Trace | None, method: str, unit: str) -> list[Markup]:
    """From above and from the side, with a tube of ±3σ across the path."""
    poses = estimate.world_from_cam if found is None else found.estimate
    cov = (
        estimate.cov_pose
        if found is None
        else (None if estimate.cov_pose is None else estimate.cov_pose[found.frames])
    )
    charts = []
    for title, i, j, labels, flip in (
        ("Path seen from above", 0, 2, (f"x, {unit} (right)", f"z, {unit} (forward)"), False),
        ("Path seen from the side", 2, 1, (f"z, {unit} (forward)", f"y, {unit} (down)"), True),
    ):
        series = (
            [] if found is None else [Series("ground truth", found.truth[:, i, 3], found.truth[:, j, 3], "m-truth")]
        )
        series.append(Series(label(method), poses[:, i, 3], poses[:, j, 3], style(method)))
        note = ""
        if cov is not None and len(poses) > 1 and not flip:  # from the side a path ahead has no width to tell
            edges, factor = _tube(poses, cov, i, j)
            name = f"±{_TUBE_SIGMAS}σ" + ("" if factor == 1 else f" × {factor:g}")
            series.append(Series(name, edges[:, 0], edges[:, 1], "tube"))
            note = "" if factor == 1 else f"the tube is drawn {factor:g} times as wide as ±{_TUBE_SIGMAS}σ"
        charts.append(draw(Chart(title, *labels, series, note=note, equal=True, flip_y=flip, height=340)))
    return charts


def _tube(poses: Array, cov: Array, i: int, j: int) -> tuple[Array, float]:
    """Both edges (2n + 1, 2) of ±3σ across the path in the plane of axes i and j, and by what it is drawn wider."""
    at = poses[:, [i, j], 3]
    along = np.gradient(at, axis=0)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.maximum(length, 1e-12)
    r = poses[:, [i, j], :3]  # rows of the rotation: axes of the camera in those of the world
    in_plane = r @ cov[:, :3, :3] @ np.swapaxes(r, 1, 2)
    sigma = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", across, in_plane, across), 0))
    extent, widest = float(np.ptp(at, axis=0).max()), _TUBE_SIGMAS * float(np.median(sigma))
    factor = 1.0
    while 0 < widest * factor < _TUBE_SHARE * extent and factor < 1000:
        factor *= 10
    offset = _TUBE_SIGMAS * factor * sigma[:, None] * across
    return np.concatenate([at + offset, np.full((1, 2), np.nan), at - offset]), factor


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


def _work(columns: RunColumns) -> list[Markup]:
    """Counts of points, innovations, and time per frame."""
    n = np.arange(len(columns.statuses))
    colours = {
        "tracked": "m-cross-frame",
        "used": "m-cross-frame-wc",
        "new": "m-ekf",
        "rejected": "m-frame-to-frame",
    }
    points = [Series(name, n, columns.counts[name], colour) for name, colour in colours.items()]
    stages = {"decode": "m-truth", "frontend": "m-cross-frame-wc", "estimator": "m-ekf", "total": "m-cross-frame"}
    times = [Series(name, n, smoothed(columns.times_ms[name]), colour) for name, colour in stages.items()]
    nis = [Series("NIS / dof", n, smoothed(columns.nis_over_dof), "m-cross-frame")]
    return [
        draw(Chart("Points", "frame", "points", points, zero=True)),
        draw(Chart("Time per frame", "frame", "ms", times, note=SMOOTHED, zero=True)),
        innovations(nis),
    ]
