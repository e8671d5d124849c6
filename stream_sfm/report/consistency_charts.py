"""Charts that need no ground truth, or compare errors with estimated uncertainties."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from ..geometry.se3 import Array
from .accuracy_charts import Traces
from .lengths import LengthUnit
from .methods import label, style
from .records import Comparison, RunRecord
from .svg import SMOOTHED, Chart, Series, draw, smoothed
from .traces import broken, closure


def _over_frames(title: str, y_label: str, series: Sequence[Series], **options: Any) -> Markup:
    return draw(Chart(title, "frame", y_label, series, **options))


def _line(name: str, x: Array, y: Array) -> Series:
    """A method's line."""
    return Series(label(name), x, y, style(name))


def _per_frame(run: RunRecord, y: Array) -> Series:
    return _line(run.name, np.arange(len(y), dtype=float), y)


def consistency(traces: Traces, runs: Iterable[RunRecord], gaps: Sequence[int]) -> list[Markup]:
    """NEES where there is ground truth, NIS in any case."""
    nis = [_per_frame(run, smoothed(run.nis_over_dof)) for run in runs]
    return [*([_nees(traces, gaps)] if traces else []), innovations(nis, gaps)]


def innovations(nis: Sequence[Series], gaps: Sequence[int] = ()) -> Markup:
    """NIS per degree of freedom, already smoothed; `gaps`: frames that are marked."""
    title, note = "Innovations (NIS per degree of freedom)", f"1 if the noise is as modelled; {SMOOTHED}"
    return _over_frames(title, "NIS / dof", nis, note=note, levels=[(1.0, "")], marks=gaps, zero=True)


def _nees(traces: Traces, gaps: Sequence[int]) -> Markup:
    from scipy.special import chdtri  # here, as a replay's page needs no SciPy, which takes a while to import

    low, high = chdtri(6, [0.975, 0.025])
    series = []
    for name, t in traces.items():
        if t.nees is not None and np.isfinite(t.nees).any():
            series.append(_line(name, *broken(t.frames, np.maximum(t.nees, 1e-3))))
    levels = [(float(low), ""), (float(high), f"95 %: {low:.1f} to {high:.1f}")] if series else ()
    note = "above the interval: overconfident"
    return _over_frames(
        "NEES of the pose", "NEES (expected: 6)", series, note=note, log_y=True, levels=levels, marks=gaps
    )


def agreement(runs: list[RunRecord], gaps: Sequence[int], unit: LengthUnit) -> list[Markup]:
    """Closure after there and back, distance between the methods, reprojection error."""
    reference = next((r for r in runs if r.name == "cross-frame"), runs[0])
    apart = []
    for run in runs:
        n = min(len(run), len(reference))
        if run is not reference and n:
            d = run.poses[:n, :3, 3] - reference.poses[:n, :3, 3]
            apart.append(_per_frame(run, np.linalg.norm(d, axis=1)))
    reprojection = [_per_frame(run, smoothed(run.column("reprojection_px"))) for run in runs]
    title, note = f"Distance from {label(reference.name)}", "positions, without alignment"
    accepted = f"accepted points, {SMOOTHED}"
    return [
        *_closures(runs, unit),
        _over_frames(title, unit.name, unit.of(apart), note=note, zero=True, marks=gaps),
        _over_frames("Reprojection error", "RMS, px", reprojection, note=accepted, zero=True, marks=gaps),
    ]


def _closures(runs: list[RunRecord], unit: LengthUnit) -> list[Markup]:
    """Two charts, none where the frames were not processed in reverse order as well."""
    found = {run.name: back for run in runs if (back := closure(run)) is not None}
    if not found:
        return []
    position = unit.of([_line(name, back.apart_m, back.position_m) for name, back in found.items()])
    rotation = [_line(name, back.apart_m, back.rotation_deg) for name, back in found.items()]
    x, note = "distance travelled between the two visits, m", "difference between two visits of a frame"
    return [
        draw(Chart("There and back: position", x, unit.name, position, note=note, zero=True)),
        draw(Chart("There and back: rotation", x, "degrees", rotation, note=note, zero=True)),
    ]


def structure(c: Comparison, unit: LengthUnit) -> list[Markup]:
    """Local structure: error of its depths where the log has depth images, estimated σ, CC against WC."""
    sigma = [_per_frame(run, unit.per_m * run.column("sigma_local_m")) for run in c.runs]
    y_label, note = f"σ along the ray, {unit.name}", "median of the points in view"
    charts = _depth_errors(c, unit)
    charts.append(_over_frames("Estimated σ of the local structure", y_label, sigma, note=note, log_y=True))
    rows = np.array(c.front.local_difference).reshape(-1, 2)
    if len(rows):
        series = [Series("CC and WC-derived", rows[:, 0], unit.per_m * rows[:, 1], "m-cross-frame-cc")]
        title, note = "Local structure: CC against WC-derived", "median distance between equal points"
        charts.append(_over_frames(title, unit.name, series, note=note, zero=True))
    return charts


def _depth_errors(c: Comparison, unit: LengthUnit) -> list[Markup]:
    """Error against depth images, and over the estimated σ; none where the log has no depth."""
    found = {run.name: np.array(run.depth_rows).T for run in c.runs if run.depth_rows}
    if not found:
        return []
    error = [_line(name, frames, unit.per_m * rms_m) for name, (frames, rms_m, _) in found.items()]
    ratio = [_line(name, frames, rms / np.maximum(std, 1e-12)) for name, (frames, rms, std) in found.items()]
    title, note = "Depth error over estimated σ", "above 1: overconfident"
    return [
        _over_frames("Depth error of the local structure", f"RMS, {unit.name}", error, log_y=True),
        _over_frames(title, "RMS error / RMS σ", ratio, note=note, levels=[(1.0, "")], log_y=True),
    ]


def work(c: Comparison) -> list[Markup]:
    """Number of points and time per frame."""
    n, gaps = np.arange(len(c.front)), c.front.gaps
    points = [
        Series("tracked from the previous frame", n, np.array(c.front.tracked, float), "m-cross-frame"),
        Series("new", n, np.array(c.front.new, float), "m-ekf"),
    ]
    stages = [
        Series(name, n, smoothed(np.array(c.front.times_ms[stage])), colour)
        for name, stage, colour in (
            ("decode (waiting)", "decode", "m-truth"),
            ("rectify", "rectify", "m-ekf-cv"),
            ("front-end", "frontend", "m-cross-frame-wc"),
        )
    ]
    rejected, estimators = (
        [_per_frame(run, smoothed(run.column(name))) for run in c.runs] for name in ("rejected", "estimator")
    )
    return [
        _over_frames("Points", "points", points, zero=True, marks=gaps),
        _over_frames("Rejected views", "points", rejected, note=SMOOTHED, zero=True, marks=gaps),
        _over_frames("Time of the shared stages", "ms", stages, note=SMOOTHED, zero=True),
        _over_frames("Time of the estimators", "ms", estimators, note=SMOOTHED, log_y=True),
    ]
