"""Charts of the errors against ground truth: path, error, drift, and error per axis."""

from collections.abc import Iterable, Sequence

import numpy as np
from markupsafe import Markup

from ..evaluation.relative import enough_known, mean_squares, spans_for
from ..evaluation.segments import lengths_for_path, segment_errors
from ..geometry.se3 import Array
from .lengths import LengthUnit
from .methods import label, style
from .records import RunRecord
from .svg import Chart, Series, draw
from .traces import Trace, broken

Traces = dict[str, Trace]
_COINCIDE = 0.01  # of the path's extent: four pixels of a chart
_AXES = ("x (right)", "y (down)", "z (forward)", "about x (pitch)", "about y (yaw)", "about z (roll)")
_MOST_SIGMA = 12.0  # a band wider than this many times the largest error is clipped: it would flatten the curve


def paths(runs: Iterable[RunRecord], traces: Traces, unit: LengthUnit, length: str = "m") -> list[Markup]:
    """The paths seen from above and from the side, in units of `length`.

    Where they coincide, one path, and how far the methods are off in the other unit.
    """
    apart_m = max((float(t.position_m.max()) for t in traces.values()), default=np.inf)
    true = next(iter(traces.values())).truth if traces else np.empty((0, 4, 4))
    if len(true) and apart_m < _COINCIDE * float(np.ptp(true[:, :3, 3], axis=0).max()):
        return _deviations(true, traces, apart_m, unit)
    charts = []
    for title, i, j, labels, flip in (
        ("Path seen from above", 0, 2, (f"x, {length} (right)", f"z, {length} (forward)"), False),
        ("Path seen from the side", 2, 1, (f"z, {length} (forward)", f"y, {length} (down)"), True),
    ):
        series = []
        if traces:
            t = next(iter(traces.values())).truth
            series.append(Series("ground truth", t[:, i, 3], t[:, j, 3], "m-truth"))
        for run in runs:
            poses = traces[run.name].estimate if run.name in traces else run.poses
            series.append(Series(label(run.name), poses[:, i, 3], poses[:, j, 3], style(run.name)))
        charts.append(draw(Chart(title, *labels, series, equal=True, flip_y=flip, height=340)))
    return charts


def _deviations(true: Array, traces: Traces, apart_m: float, unit: LengthUnit) -> list[Markup]:
    """The true path from above, then deviations to the side, upwards and along it, over the distance travelled."""
    path = Chart(
        "Path seen from above",
        "x, m (right)",
        "z, m (forward)",
        [Series("ground truth", true[:, 0, 3], true[:, 2, 3], "m-truth")],
        note=f"estimates coincide with it within {unit.per_m * apart_m:.2g} {unit.name}: deviations beside and below",
        equal=True,
        height=340,
    )
    charts = [draw(path)]
    for title, axis in (("Deviation to the side", 0), ("Deviation downwards", 1), ("Deviation along the path", 2)):
        series = []
        for name, t in traces.items():
            off = t.estimate[:, :3, 3] - t.truth[:, :3, 3]
            y = np.einsum("ni,ni->n", off, _side_down_along(t.truth)[:, axis])
            _, distance, y = broken(t.frames, t.distance_m, y)
            series.append(Series(label(name), distance, unit.per_m * y, style(name)))
        chart = Chart(title, "distance travelled, m", unit.name, series, note="first poses aligned")
        charts.append(draw(chart))
    return charts


def _side_down_along(true: Array) -> Array:
    """Unit vectors (n, 3, 3) of each frame, one per row: to the right of the path, downwards, and along it."""
    along = np.gradient(true[:, :3, 3], axis=0)
    standing = np.linalg.norm(along, axis=1) < 1e-9
    along[standing] = true[standing, :3, 2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(true[:, :3, 1], along)  # the camera's own down
    length = np.linalg.norm(side, axis=1, keepdims=True)
    side = np.where(length > 1e-6, side / np.maximum(length, 1e-6), true[:, :3, 0])
    return np.stack([side, np.cross(along, side), along], axis=1)


def errors(traces: Traces, gaps: Sequence[int], unit: LengthUnit) -> list[Markup]:
    """Position and rotation error over the frames and over the distance travelled."""
    return [
        _error(traces, gaps, by_distance, None if rotation else unit)
        for by_distance in (False, True)
        for rotation in (False, True)
    ]


def _error(traces: Traces, gaps: Sequence[int], by_distance: bool, unit: LengthUnit | None) -> Markup:
    """The error of the position, or without a unit of length of the rotation, degrees."""
    series = []
    for name, t in traces.items():
        frames, distance, y = broken(t.frames, t.distance_m, t.position_m if unit else t.rotation_deg)
        series.append(Series(label(name), distance if by_distance else frames, y, style(name)))
    what = "Position" if unit else "Rotation"
    return draw(
        Chart(
            f"{what} error over {'distance' if by_distance else 'frames'}",
            "distance travelled, m" if by_distance else "frame",
            f"error, {unit.name if unit else 'degrees'}",
            unit.of(series) if unit else series,
            note="first poses aligned",
            zero=True,
            marks=() if by_distance else gaps,
        )
    )


def drift(traces: Traces, unit: LengthUnit) -> list[Markup]:
    """Segment errors as defined by KITTI, and relative errors over spans of frames."""
    note = "mean over all segments of a length"
    t_rel, r_rel = _segments(traces)
    charts = [
        draw(Chart("Position drift per distance", "segment length, m", "%", t_rel, note=note, zero=True)),
        draw(Chart("Rotation drift per distance", "segment length, m", "° per 100 m", r_rel, note=note, zero=True)),
    ]
    note = "RMS over all starts; slope ½: random walk, 1: bias"
    position, rotation = _spans(traces)
    for title, name, series in (
        ("Relative position error", unit.name, unit.of(position)),
        ("Relative rotation error", "degrees", rotation),
    ):
        charts.append(draw(Chart(title, "span, frames", name, series, note=note, log_x=True, log_y=True)))
    return charts


def _segments(traces: Traces) -> tuple[list[Series], list[Series]]:
    """t_rel and r_rel against the length of the segments."""
    t_rel: list[Series] = []
    r_rel: list[Series] = []
    for name, t in traces.items():
        lengths, step = lengths_for_path(float(t.distance_m[-1]))
        found = [(x, segment_errors(t.estimate, t.truth, (x,), step)) for x in lengths if x > 0]
        found = [(x, s) for x, s in found if s.count]
        x = np.array([x for x, _ in found])
        for series, y in (
            (t_rel, [s.t_rel_percent for _, s in found]),
            (r_rel, [s.r_rel_deg_per_100m for _, s in found]),
        ):
            series.append(Series(label(name), x, np.array(y), style(name), dots=True))
    return t_rel, r_rel


def _spans(traces: Traces) -> tuple[list[Series], list[Series]]:
    """RMS errors of relative motions, metres and degrees, against the span in frames."""
    position, rotation = [], []
    for name, t in traces.items():
        estimate, truth = np.full((2, t.frames[-1] - t.frames[0] + 1, 4, 4), np.nan)
        estimate[t.frames - t.frames[0]], truth[t.frames - t.frames[0]] = t.estimate, t.truth
        if enough_known(truth) and (spans := spans_for(len(t.frames))):
            p2, q2 = mean_squares(estimate, truth, spans)
            x = np.array(spans, float)
            position.append(Series(label(name), x, np.sqrt(p2), style(name), dots=True))
            rotation.append(Series(label(name), x, np.degrees(np.sqrt(q2)), style(name), dots=True))
    return position, rotation


def axes(t: Trace, name: str, length: LengthUnit) -> list[Markup]:
    """The six components of a method's error in the axes of the camera, with its estimated ±3σ."""
    charts = []
    for k, axis in enumerate(_AXES):
        kind, unit, scale = (
            ("Position", length.name, length.per_m) if k < 3 else ("Rotation", "degrees", np.degrees(1))
        )
        columns = [scale * t.xi[:, k]]
        if t.sigma is not None:
            columns.append(3 * scale * t.sigma[:, k])
        frames, *columns = broken(t.frames, *columns)
        band = None if t.sigma is None else np.stack([-columns[1], columns[1]])
        if band is not None:
            most = max(_MOST_SIGMA * np.nanmax(abs(columns[0])), 1e-6)
            band = np.clip(band, -most, most)
        series = [Series(label(name), frames, columns[0], style(name), band=band)]
        charts.append(draw(Chart(f"{kind} {axis}", "frame", unit, series, width=340, height=210)))
    return charts
