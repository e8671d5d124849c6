"""The charts of the report, from the records of a comparison."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from markupsafe import Markup
from scipy.stats import chi2

from ..evaluation.relative import mean_squares, spans_for
from ..evaluation.segments import lengths_for_path, segment_errors
from ..geometry.se3 import Array
from .records import Comparison, MethodRun
from .svg import Chart, Series, draw
from .traces import Trace, broken, closure

LABELS = {
    "cross-frame": "cross-frame",
    "cross-frame-wc": "per-point WC",
    "cross-frame-cc": "per-point CC",
    "ekf": "EKF",
    "ekf-cv": "EKF, constant velocity",
    "frame-to-frame": "frame to frame",
}
_AXES = ("x (right)", "y (down)", "z (forward)", "about x (pitch)", "about y (yaw)", "about z (roll)")
Traces = dict[str, Trace]


def style(name: str) -> str:
    """CSS class of a method's lines."""
    return f"m-{name}" if name in LABELS else "m-other"


def label(name: str) -> str:
    """A method's name in legends."""
    return LABELS.get(name, name)


def errors(traces: Traces, marks: list[int]) -> list[Markup]:
    """Position and rotation error against frame and against distance."""
    charts = []
    for by_distance in (False, True):
        for rotation in (False, True):
            series = []
            for name, t in traces.items():
                y = t.rotation_deg if rotation else t.position_m
                frames, distance, y = broken(t.frames, t.distance_m, y)
                series.append(Series(label(name), distance if by_distance else frames, y, style(name)))
            what, unit = ("Rotation", "degrees") if rotation else ("Position", "m")
            if not rotation and all(np.nanmax(s.y) < 0.1 for s in series):
                series, unit = [replace(s, y=1e3 * s.y) for s in series], "mm"
            charts.append(
                draw(
                    Chart(
                        f"{what} error against {'distance' if by_distance else 'frame'}",
                        "distance travelled, m" if by_distance else "frame",
                        f"error, {unit}",
                        series,
                        note="first poses aligned",
                        zero=True,
                        marks=[] if by_distance else marks,
                    )
                )
            )
    return charts


def paths(runs: Iterable[MethodRun], traces: Traces) -> list[Markup]:
    """Path from above and from the side."""
    charts = []
    for title, i, j, labels, flip in (
        ("Path from above", 0, 2, ("x, m (right)", "z, m (forward)"), False),
        ("Path from the side", 2, 1, ("z, m (forward)", "y, m (down)"), True),
    ):
        series = []
        if traces:
            t = next(iter(traces.values())).truth
            series.append(Series("ground truth", t[:, i, 3], t[:, j, 3], "m-truth"))
        for run in runs:
            poses = traces[run.name].estimate if run.name in traces else np.array(run.poses).reshape(-1, 4, 4)
            series.append(Series(label(run.name), poses[:, i, 3], poses[:, j, 3], style(run.name)))
        charts.append(draw(Chart(title, *labels, series, equal=True, flip_y=flip, height=340)))
    return charts


def drift(traces: Traces) -> list[Markup]:
    """Segments as KITTI has them, and RPE against the span."""
    t_series, r_series, p_series, q_series = [], [], [], []
    for name, t in traces.items():
        lengths, step = lengths_for_path(float(t.distance_m[-1]))
        found = [(x, segment_errors(t.estimate, t.truth, (x,), step)) for x in lengths if x > 0]
        found = [(x, s) for x, s in found if s.count]
        x = np.array([x for x, _ in found])
        t_series.append(
            Series(label(name), x, np.array([s.t_rel_percent for _, s in found]), style(name), dots=True)
        )
        r = np.array([s.r_rel_deg_per_100m for _, s in found])
        r_series.append(Series(label(name), x, r, style(name), dots=True))
        if _consecutive(t) and (spans := spans_for(len(t.frames))):
            p2, q2 = mean_squares(t.estimate, t.truth, spans)
            at = np.array(spans, float)
            p_series.append(Series(label(name), at, 1e3 * np.sqrt(p2), style(name), dots=True))
            q_series.append(Series(label(name), at, np.degrees(np.sqrt(q2)), style(name), dots=True))
    note = "mean over all segments of a length"
    rpe = "RMS over all starts; slope ½: random walk, slope 1: bias"
    return [
        draw(Chart("Drift per distance: position", "segment, m", "per cent", t_series, note=note, zero=True)),
        draw(Chart("Drift per distance: rotation", "segment, m", "° per 100 m", r_series, note=note, zero=True)),
        draw(Chart("Relative position error", "span, frames", "mm", p_series, note=rpe, log_x=True, log_y=True)),
        draw(
            Chart("Relative rotation error", "span, frames", "degrees", q_series, note=rpe, log_x=True, log_y=True)
        ),
    ]


def axes(t: Trace, name: str) -> list[Markup]:
    """Six components of the error, in axes of the camera, with the ±3σ that the method claims."""
    charts = []
    for k, axis in enumerate(_AXES):
        factor, unit = (1e3, "mm") if k < 3 else (1e3, "mrad")
        y = factor * t.xi[:, k]
        cols = [y] if t.sigma is None else [y, factor * 3 * t.sigma[:, k]]
        frames, *cols = broken(t.frames, *cols)
        band = None if t.sigma is None else np.stack([-cols[1], cols[1]])
        if band is not None:  # a claim far beyond the errors would flatten the curve: draw what is near
            most = max(12 * np.nanmax(abs(cols[0])), 1e-6)
            band = np.clip(band, -most, most)
        series = [Series(label(name), frames, cols[0], style(name), band=band)]
        kind = "Position" if k < 3 else "Rotation"
        charts.append(draw(Chart(f"{kind} {axis}", "frame", unit, series, width=340, height=210)))
    return charts


def consistency(traces: Traces, runs: Iterable[MethodRun], marks: list[int]) -> list[Markup]:
    """NEES where there is truth, NIS in any case."""
    low, high = chi2.ppf([0.025, 0.975], 6)
    nees = []
    for name, t in traces.items():
        if t.nees is not None and np.isfinite(t.nees).any():
            frames, values = broken(t.frames, np.maximum(t.nees, 1e-3))
            nees.append(Series(label(name), frames, values, style(name)))
    nis = []
    for run in runs:
        dof = np.array(run.nis_dof, float)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(dof > 0, np.array(run.nis) / dof, np.nan)
        nis.append(Series(label(run.name), np.arange(len(ratio)), _smooth(ratio), style(run.name)))
    bounds = [(float(low), ""), (float(high), f"95 %: {low:.1f} to {high:.1f}")]
    charts = []
    if traces:
        charts.append(
            draw(
                Chart(
                    "NEES of the pose",
                    "frame",
                    "NEES (6 expected)",
                    nees,
                    note="above: claims too much",
                    log_y=True,
                    levels=bounds if nees else (),
                    marks=marks,
                )
            )
        )
    charts.append(
        draw(
            Chart(
                "Innovations (NIS per degree of freedom)",
                "frame",
                "NIS / dof",
                nis,
                note="1: the noise is as assumed; mean of 5 frames",
                levels=[(1.0, "")],
                marks=marks,
                zero=True,
            )
        )
    )
    return charts


def without_truth(runs: list[MethodRun], marks: list[int]) -> list[Markup]:
    """There and back, divergence between methods, reprojection."""
    position, rotation, apart, reprojection = [], [], [], []
    reference = next((r for r in runs if r.name == "cross-frame"), runs[0])
    for run in runs:
        if (found := closure(run)) is not None:
            position.append(Series(label(run.name), found.apart_m, found.position_m, style(run.name)))
            rotation.append(Series(label(run.name), found.apart_m, found.rotation_deg, style(run.name)))
        n = min(len(run.poses), len(reference.poses))
        if run is not reference and n:
            d = np.array(run.poses[:n])[:, :3, 3] - np.array(reference.poses[:n])[:, :3, 3]
            apart.append(Series(label(run.name), np.arange(n), np.linalg.norm(d, axis=1), style(run.name)))
        y = np.array(run.reprojection_px, float)
        reprojection.append(Series(label(run.name), np.arange(len(y)), _smooth(y), style(run.name)))
    charts = []
    if position:
        x = "distance between the two visits, m"
        note = "each frame visited twice"
        charts += [
            draw(Chart("There and back: position", x, "m apart", position, note=note, zero=True)),
            draw(Chart("There and back: rotation", x, "degrees apart", rotation, note=note, zero=True)),
        ]
    return [
        *charts,
        draw(
            Chart(
                f"Distance from {label(reference.name)}",
                "frame",
                "m",
                apart,
                note="positions, no alignment",
                zero=True,
                marks=marks,
            )
        ),
        draw(
            Chart(
                "Reprojection error",
                "frame",
                "RMS, px",
                reprojection,
                note="accepted points, mean of 5 frames",
                zero=True,
                marks=marks,
            )
        ),
    ]


def structure(c: Comparison) -> list[Markup]:
    """Local structure: against depth where the log has it; claimed σ; CC against WC-derived."""
    depth, claim = [], []
    for run in c.runs:
        rows = np.array(run.depth_rows).reshape(-1, 3)
        if len(rows):
            depth.append(Series(label(run.name), rows[:, 0], 1e3 * rows[:, 1], style(run.name)))
        sigma = 1e3 * np.array(run.sigma_local_m, float)
        claim.append(Series(label(run.name), np.arange(len(sigma)), sigma, style(run.name)))
    charts = []
    if depth:
        ratio = []
        for run in c.runs:
            rows = np.array(run.depth_rows).reshape(-1, 3)
            if len(rows):
                ratio.append(
                    Series(label(run.name), rows[:, 0], rows[:, 1] / np.maximum(rows[:, 2], 1e-12), style(run.name))
                )
        charts += [
            draw(Chart("Depth error of the local structure", "frame", "RMS, mm", depth, log_y=True)),
            draw(
                Chart(
                    "Depth error over claimed σ",
                    "frame",
                    "RMS error / RMS σ",
                    ratio,
                    note="above 1: claims too much",
                    levels=[(1.0, "")],
                    log_y=True,
                )
            ),
        ]
    charts.append(
        draw(
            Chart(
                "Claimed σ of the local structure",
                "frame",
                "σ along the ray, mm",
                claim,
                note="median of the points in view",
                log_y=True,
            )
        )
    )
    rows = np.array(c.local_difference).reshape(-1, 2)
    if len(rows):
        series = [Series("CC and WC-derived", rows[:, 0], 1e3 * rows[:, 1], "m-cross-frame-cc")]
        note = "median distance of the same points"
        charts.append(
            draw(Chart("Local structure, CC against WC-derived", "frame", "mm", series, note=note, zero=True))
        )
    return charts


def work(c: Comparison) -> list[Markup]:
    """Points and milliseconds a frame."""
    n = np.arange(len(c.front.tracked))
    counts = [
        Series("tracked from the frame before", n, np.array(c.front.tracked, float), "m-cross-frame"),
        Series("new", n, np.array(c.front.new, float), "m-ekf"),
    ]
    rejected = [
        Series(label(r.name), np.arange(len(r.rejected)), _smooth(np.array(r.rejected, float)), style(r.name))
        for r in c.runs
    ]
    stages = [
        Series("decode (wait)", n, _smooth(np.array(c.front.decode_ms)), "m-truth"),
        Series("rectify", n, _smooth(np.array(c.front.rectify_ms)), "m-ekf-cv"),
        Series("front-end", n, _smooth(np.array(c.front.frontend_ms)), "m-cross-frame-wc"),
    ]
    estimators = [
        Series(label(r.name), np.arange(len(r.estimator_ms)), _smooth(np.array(r.estimator_ms)), style(r.name))
        for r in c.runs
    ]
    smooth = "mean of 5 frames"
    marks = c.front.gaps
    return [
        draw(Chart("Points", "frame", "points", counts, zero=True, marks=marks)),
        draw(Chart("Views rejected", "frame", "points", rejected, note=smooth, zero=True, marks=marks)),
        draw(Chart("Shared stages", "frame", "ms", stages, note=smooth, zero=True)),
        draw(Chart("Estimators", "frame", "ms", estimators, note=smooth, log_y=True)),
    ]


def _smooth(y: Array, frames: int = 5) -> Array:
    if len(y) < 3 * frames:
        return y
    good = np.isfinite(y)
    kernel = np.ones(frames)
    weight = np.convolve(good, kernel, "same")
    with np.errstate(invalid="ignore"):
        return np.where(
            weight > 0, np.convolve(np.where(good, y, 0.0), kernel, "same") / np.maximum(weight, 1), np.nan
        )


def _consecutive(t: Trace) -> bool:
    return bool(t.frames[-1] - t.frames[0] == len(t.frames) - 1)
