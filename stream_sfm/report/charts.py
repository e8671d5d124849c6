"""The charts of the pages, from records of runs and their traces against ground truth."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from ..evaluation.relative import enough_known, mean_squares, spans_for
from ..geometry.se3 import Array
from .front_record import FrontRecord
from .lengths import LengthUnit
from .methods import Look, of_method, short, style
from .records import NO_LOOPS, RunRecord
from .svg import Chart, Row, Series, draw, figure, intervals, lifetimes
from .traces import Trace, broken
from .verdict import NEES_INTERVAL, REFERENCE

Traces = dict[str, Trace]
_LEAST_NEES = 0.1  # least value drawn: the first poses are exact by definition
_COINCIDE = 0.02  # share of the path's extent: eight pixels of a chart
_MOST_LIVES = 1200  # lines; more cannot be told apart

Looks = Callable[[str], Look]


def _line(look: Look, x: Array, y: Array, dots: bool = False) -> Series:
    """A line with its name."""
    return Series(look.name, x, y, look.style, dots, look.quiet)


def _along(look: Look, t: Trace, x: Array, y: Array) -> Series:
    """A line that is broken where frames have no truth."""
    _, x, y = broken(t.frames, x, y)
    return _line(look, x, y)


def _grey_first(series: Iterable[Series]) -> list[Series]:
    """Lines in colour are drawn over grey ones."""
    return sorted(series, key=lambda s: not s.quiet)


def path(
    poses: Mapping[str, Array],
    traces: Traces,
    unit: LengthUnit,
    looks: Looks = of_method,
    loops: Array = NO_LOOPS,
) -> Markup:
    """The path seen from above: the true one, else the first method's, and the others where they do not coincide.

    `loops` (n, 2, 3): the ends of lines between places that were seen again.
    """
    found = {name: traces[name].estimate if name in traces else of_run for name, of_run in poses.items()}
    series = [_line(looks(name), shown[:, 0, 3], shown[:, 2, 3]) for name, shown in found.items()]
    if not found:
        return draw(Chart("Path", "x", "z", []))
    if traces:
        true = next(iter(traces.values())).truth
        series.insert(0, Series("ground truth", true[:, 0, 3], true[:, 2, 3], "m-truth"))
        apart_m = max(float(t.position_m.max()) for t in traces.values())
    else:
        true, *others = found.values()
        apart_m = max((_farthest_m(true, other) for other in others), default=np.inf)
    note = "from above"
    if coincide := len(series) > 1 and apart_m < _COINCIDE * float(np.ptp(true[:, :3, 3], axis=0).max()):
        note += f"; all estimates are within {unit.per_m * apart_m:.2g} {unit.name}"
    labels = ("x, m (right)", "z, m (forward)")
    series = series[:1] if coincide else series
    if len(loops):
        ends = np.concatenate([loops, np.full_like(loops[:, :1], np.nan)], axis=1).reshape(-1, 3)
        series.append(Series("loops", ends[:, 0], ends[:, 2], "m-other", dots=True, quiet=True))
    return draw(Chart("Path", *labels, series, note=note, path=True))


def _farthest_m(one: Array, other: Array) -> float:
    """The largest distance between poses of two paths, as far as both go."""
    n = min(len(one), len(other))
    return float(np.linalg.norm(one[:n, :3, 3] - other[:n, :3, 3], axis=1).max())


def errors(traces: Traces, unit: LengthUnit, looks: Looks = of_method) -> Markup:
    """Position errors over the distance travelled."""
    series = [_along(looks(name), t, t.distance_m, t.position_m) for name, t in traces.items()]
    return _over_distance("Position error", unit.name, unit.of(series), "first poses aligned")


def rotation_errors(traces: Traces, looks: Looks = of_method) -> Markup:
    """Rotation errors over the distance travelled."""
    series = [_along(looks(name), t, t.distance_m, t.rotation_deg) for name, t in traces.items()]
    return _over_distance("Rotation error", "degrees", series, "first poses aligned")


def _over_distance(title: str, y_label: str, series: Sequence[Series], note: str) -> Markup:
    return draw(Chart(title, "distance travelled, m", y_label, _grey_first(series), note=note, zero=True))


def ratios(content: dict[str, Any]) -> Markup:
    """Errors of each method over those of the reference, with intervals; `content` of report.json."""
    rows = [
        Row(short(key) if quantity == "position" else "", f["value"], f["ci95"][0], f["ci95"][1], style(key))
        for key, found in content["error_over_cross_frame"].items()
        for quantity, f in found.items()
    ]
    note = "position above rotation, 95 %"
    return intervals(f"Errors over those of {REFERENCE}", "ratio (logarithmic)", rows, note)


def nees(traces: Traces, gaps: Sequence[int] = (), looks: Looks = of_method) -> Markup:
    """NEES of the pose over the frames."""
    series = [
        _along(looks(name), t, t.frames.astype(float), np.maximum(t.nees, _LEAST_NEES))
        for name, t in traces.items()
        if t.nees is not None and np.isfinite(t.nees).any()
    ]
    note = "shaded: 95 % where the covariance holds; above: too small"
    return _over_frames("NEES of the pose", "NEES", series, note, gaps, log_y=True, expected=NEES_INTERVAL)


def innovations(runs: Iterable[RunRecord], gaps: Sequence[int] = ()) -> Markup:
    """Squared innovations per degree of freedom over the frames."""
    series = [_per_frame(run.name, _smoothed(run.nis_over_dof)) for run in runs]
    note = "1 expected; mean over 5 frames"
    return _over_frames("Squared innovations per degree of freedom", "NIS / dof", series, note, gaps, zero=True)


def apart(runs: Sequence[RunRecord], gaps: Sequence[int], unit: LengthUnit) -> Markup:
    """Distance of each method's positions from those of the reference, else of the first method."""
    reference = next((r for r in runs if r.name == REFERENCE), runs[0])
    series = []
    for run in runs:
        n = min(len(run), len(reference))
        if run is not reference and n:
            d = run.poses[:n, :3, 3] - reference.poses[:n, :3, 3]
            series.append(_per_frame(run.name, np.linalg.norm(d, axis=1)))
    title = f"Distance from {short(reference.name)}"
    return _over_frames(title, unit.name, unit.of(series), "positions, not aligned", gaps, zero=True)


def growth(traces: Traces, unit: LengthUnit) -> Markup:
    """RMS errors of relative motions over spans of frames."""
    series = []
    for name, t in traces.items():
        estimate, truth = np.full((2, t.frames[-1] - t.frames[0] + 1, 4, 4), np.nan)
        estimate[t.frames - t.frames[0]], truth[t.frames - t.frames[0]] = t.estimate, t.truth
        if enough_known(truth) and (spans := spans_for(len(t.frames))):
            squares, _ = mean_squares(estimate, truth, spans)
            series.append(_line(of_method(name), np.array(spans, float), np.sqrt(squares), dots=True))
    note = "slope ½: random walk, 1: bias"
    lines = _grey_first(unit.of(series))
    title = "Error of relative motions"
    return draw(Chart(title, "span, frames", unit.name, lines, note=note, log_x=True, log_y=True))


def structure(runs: Iterable[RunRecord], unit: LengthUnit) -> Markup:
    """Error of the depths of local points over their σ where the log has depth images, else σ along the rays."""
    runs = list(runs)
    found = {run.name: np.array(run.depth_rows).T for run in runs if run.depth_rows}
    if found:
        series = [_line(of_method(name), x, rms / np.maximum(std, 1e-12)) for name, (x, rms, std) in found.items()]
        title, note = "Depth error of local points", "over σ, 1 expected"
        return _over_frames(title, "RMS error / RMS σ", series, note, log_y=True)
    series = [_per_frame(run.name, unit.per_m * run.column("sigma_local_m")) for run in runs]
    return _over_frames("σ of local points", f"along the ray, {unit.name}", series, "median", log_y=True)


def lives(front: FrontRecord) -> Markup:
    """The lives of the tracks, the paper's Figure 3: one line per point, in order of the first frame."""
    spans = list(front.lives.values())
    if not spans:
        return Markup('<p class="none">No point was tracked.</p>')
    drawn = lifetimes(spans[:: max(1, -(-len(spans) // _MOST_LIVES))])
    note = f"{len(spans)} points, one line each, seen in {front.tracks()['mean_frames']:.1f} frames in the mean"
    return figure("Track lifetimes", note, drawn, "wide")


def _smoothed(y: Array) -> Array:
    """The running mean over five frames; short series are returned as they are, NaN is left out."""
    if len(y) < 15:
        return y
    good = np.isfinite(y)
    weight, total = (np.convolve(v, np.ones(5), "same") for v in (good, np.where(good, y, 0.0)))
    return np.where(weight > 0, total / np.maximum(weight, 1), np.nan)


def _per_frame(name: str, y: Array) -> Series:
    return _line(of_method(name), np.arange(len(y), dtype=float), y)


def _over_frames(
    title: str, y_label: str, series: Iterable[Series], note: str = "", gaps: Sequence[int] = (), **options: Any
) -> Markup:
    return draw(Chart(title, "frame", y_label, _grey_first(series), note=note, marks=gaps, **options))
