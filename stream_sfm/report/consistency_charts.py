"""Charts that need no ground truth, or compare errors with estimated uncertainties."""

from collections.abc import Iterable, Sequence

import numpy as np
from markupsafe import Markup

from .accuracy_charts import Traces
from .lengths import LengthUnit
from .methods import label, style
from .records import Comparison, RunRecord
from .svg import SMOOTHED, Chart, Series, draw, smoothed
from .traces import broken, closure


def consistency(traces: Traces, runs: Iterable[RunRecord], gaps: Sequence[int]) -> list[Markup]:
    """NEES where there is ground truth, NIS in any case."""
    nis = []
    for run in runs:
        ratio = run.nis_over_dof
        nis.append(Series(label(run.name), np.arange(len(ratio)), smoothed(ratio), style(run.name)))
    return [*([_nees(traces, gaps)] if traces else []), innovations(nis, gaps)]


def innovations(nis: Sequence[Series], gaps: Sequence[int] = ()) -> Markup:
    """NIS per degree of freedom, already smoothed; `gaps`: frames that are marked."""
    chart = Chart(
        "Innovations (NIS per degree of freedom)",
        "frame",
        "NIS / dof",
        nis,
        note=f"1 if the noise is as modelled; {SMOOTHED}",
        levels=[(1.0, "")],
        marks=gaps,
        zero=True,
    )
    return draw(chart)


def _nees(traces: Traces, gaps: Sequence[int]) -> Markup:
    from scipy.special import chdtri  # here, as a replay's page needs no SciPy, which takes a while to import

    low, high = chdtri(6, [0.975, 0.025])
    series = []
    for name, t in traces.items():
        if t.nees is not None and np.isfinite(t.nees).any():
            frames, values = broken(t.frames, np.maximum(t.nees, 1e-3))
            series.append(Series(label(name), frames, values, style(name)))
    levels = [(float(low), ""), (float(high), f"95 %: {low:.1f} to {high:.1f}")]
    return draw(
        Chart(
            "NEES of the pose",
            "frame",
            "NEES (expected: 6)",
            series,
            note="above the interval: overconfident",
            log_y=True,
            levels=levels if series else (),
            marks=gaps,
        )
    )


def agreement(runs: list[RunRecord], gaps: Sequence[int], unit: LengthUnit) -> list[Markup]:
    """Closure after there and back, distance between the methods, reprojection error."""
    reference = next((r for r in runs if r.name == "cross-frame"), runs[0])
    apart, reprojection = [], []
    for run in runs:
        n = min(len(run), len(reference))
        if run is not reference and n:
            d = run.poses[:n, :3, 3] - reference.poses[:n, :3, 3]
            apart.append(Series(label(run.name), np.arange(n), np.linalg.norm(d, axis=1), style(run.name)))
        y = run.column("reprojection_px")
        reprojection.append(Series(label(run.name), np.arange(len(y)), smoothed(y), style(run.name)))
    title, note = f"Distance from {label(reference.name)}", "positions, without alignment"
    return [
        *_closures(runs, unit),
        draw(Chart(title, "frame", unit.name, unit.of(apart), note=note, zero=True, marks=gaps)),
        draw(
            Chart(
                "Reprojection error",
                "frame",
                "RMS, px",
                reprojection,
                note=f"accepted points, {SMOOTHED}",
                zero=True,
                marks=gaps,
            )
        ),
    ]


def _closures(runs: list[RunRecord], unit: LengthUnit) -> list[Markup]:
    """Two charts, none where the frames were not processed in reverse order as well."""
    position, rotation = [], []
    for run in runs:
        if (found := closure(run)) is not None:
            position.append(Series(label(run.name), found.apart_m, found.position_m, style(run.name)))
            rotation.append(Series(label(run.name), found.apart_m, found.rotation_deg, style(run.name)))
    if not position:
        return []
    x, note = "distance travelled between the two visits, m", "difference between two visits of a frame"
    return [
        draw(Chart("There and back: position", x, unit.name, unit.of(position), note=note, zero=True)),
        draw(Chart("There and back: rotation", x, "degrees", rotation, note=note, zero=True)),
    ]


def structure(c: Comparison, unit: LengthUnit) -> list[Markup]:
    """Local structure: error of its depths where the log has depth images, estimated σ, CC against WC."""
    sigma = []
    for run in c.runs:
        y = unit.per_m * run.column("sigma_local_m")
        sigma.append(Series(label(run.name), np.arange(len(y)), y, style(run.name)))
    note = "median of the points in view"
    charts = [
        *_depth_errors(c, unit),
        draw(
            Chart(
                "Estimated σ of the local structure",
                "frame",
                f"σ along the ray, {unit.name}",
                sigma,
                note=note,
                log_y=True,
            )
        ),
    ]
    rows = np.array(c.front.local_difference).reshape(-1, 2)
    if len(rows):
        series = [Series("CC and WC-derived", rows[:, 0], unit.per_m * rows[:, 1], "m-cross-frame-cc")]
        note = "median distance between equal points"
        charts.append(
            draw(Chart("Local structure: CC against WC-derived", "frame", unit.name, series, note=note, zero=True))
        )
    return charts


def _depth_errors(c: Comparison, unit: LengthUnit) -> list[Markup]:
    """Error against depth images, and over the estimated σ; none where the log has no depth."""
    error, ratio = [], []
    for run in c.runs:
        rows = np.array(run.depth_rows).reshape(-1, 3)
        if len(rows):
            error.append(Series(label(run.name), rows[:, 0], unit.per_m * rows[:, 1], style(run.name)))
            over = rows[:, 1] / np.maximum(rows[:, 2], 1e-12)
            ratio.append(Series(label(run.name), rows[:, 0], over, style(run.name)))
    if not error:
        return []
    return [
        draw(Chart("Depth error of the local structure", "frame", f"RMS, {unit.name}", error, log_y=True)),
        draw(
            Chart(
                "Depth error over estimated σ",
                "frame",
                "RMS error / RMS σ",
                ratio,
                note="above 1: overconfident",
                levels=[(1.0, "")],
                log_y=True,
            )
        ),
    ]


def work(c: Comparison) -> list[Markup]:
    """Number of points and time per frame."""
    n = np.arange(len(c.front))
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
    rejected = [_per_frame(run, "rejected") for run in c.runs]
    estimators = [_per_frame(run, "estimator") for run in c.runs]
    gaps = c.front.gaps
    return [
        draw(Chart("Points", "frame", "points", points, zero=True, marks=gaps)),
        draw(Chart("Rejected views", "frame", "points", rejected, note=SMOOTHED, zero=True, marks=gaps)),
        draw(Chart("Time of the shared stages", "frame", "ms", stages, note=SMOOTHED, zero=True)),
        draw(Chart("Time of the estimators", "frame", "ms", estimators, note=SMOOTHED, log_y=True)),
    ]


def _per_frame(run: RunRecord, column: str) -> Series:
    return Series(label(run.name), np.arange(len(run)), smoothed(run.column(column)), style(run.name))
