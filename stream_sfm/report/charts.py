"""The charts of the pages, from records of runs and their traces against ground truth, and pictures of masks."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from ..camera.masks import Mask
from ..camera.rig import MonoRig, StereoRig
from ..evaluation.association import matched
from ..evaluation.drift import KINDS
from ..evaluation.figures import NEES_INTERVAL, LengthUnit
from ..evaluation.trajectory import distances_m, from_first_camera, nees_pose
from ..geometry import Array, se3
from ..methods import REFERENCE
from ..record import record
from ..types import Trajectory
from .records import NO_LOOPS, FrontRecord, RunRecord
from .svg import Chart, Row, Series, draw, intervals, lifetimes
from .tables import Look, Looks, of_method

_CELLS = 64  # per row of the picture of a mask; smaller parts are not visible on a page


@record
class Trace:
    """One method against ground truth, in the k frames that have one, first poses aligned.

    `position_m` (k,): lengths of the position errors; `rotation_deg` (k,): angles of the rotation errors; `nees` (k,):
    NaN if the ground truth does not begin with the first frame.
    """

    frames: NDArray[np.int64]
    distance_m: Array
    estimate: Array
    truth: Array
    position_m: Array
    rotation_deg: Array
    nees: Array


def _trace_of(estimate: Trajectory, truth: Trajectory, std_truth: tuple[float, float]) -> Trace | None:
    """Return the trace of a trajectory; None if fewer than two frames have a ground truth."""
    rows, true = matched(estimate, truth)
    if len(rows) < 2:
        return None
    e, t = from_first_camera(estimate.world_from_cam[rows]), from_first_camera(true.world_from_cam)
    xi = se3.log(se3.inverse(e) @ t)
    nees = np.full(len(rows), np.nan)
    if estimate.cov_pose is not None and rows[0] == 0:
        nees = nees_pose(e, estimate.cov_pose[rows], t, std_truth)
    position_m, rotation_rad = np.linalg.norm(e[:, :3, 3] - t[:, :3, 3], axis=1), np.linalg.norm(xi[:, 3:], axis=1)
    return Trace(rows, distances_m(t), e, t, position_m, np.degrees(rotation_rad), nees)


Traces = dict[str, Trace]


def traces_of(runs: Iterable[tuple[str, Trajectory, Trajectory | None, tuple[float, float]]]) -> Traces:
    """Return the traces by name of those runs (name, estimate, ground truth, its σ) that can be compared with it."""
    found = ((name, _trace_of(estimate, truth, std)) for name, estimate, truth, std in runs if truth is not None)
    return {name: trace for name, trace in found if trace is not None}


def _line(look: Look, x: Array, y: Array, dots: bool = False) -> Series:
    return Series(look.name, x, y, look.colour, dots)


def path(poses: Mapping[str, Array], traces: Traces, looks: Looks = of_method, loops: Array = NO_LOOPS) -> Markup:
    """Return the paths seen from above, the true one first. `loops` (n, 2, 3): ends of the lines of loops."""
    found = {name: traces[name].estimate if name in traces else of_run for name, of_run in poses.items()}
    series = [_line(looks(name), shown[:, 0, 3], shown[:, 2, 3]) for name, shown in found.items()]
    if traces:
        true = next(iter(traces.values())).truth
        series.insert(0, Series("ground truth", true[:, 0, 3], true[:, 2, 3], "truth"))
    if len(loops):
        ends = np.concatenate([loops, np.full_like(loops[:, :1], np.nan)], axis=1).reshape(-1, 3)
        series.append(Series("loops", ends[:, 0], ends[:, 2], "other", dots=True))
    note = "from above, from the dot to the ring"
    return draw(Chart("Path", "x, m (right)", "z, m (forward)", series, note=note, path=True))


def _of_traces(traces: Traces, looks: Looks, y: Callable[[Trace], Array], x: Callable[[Trace], Array]) -> list[Series]:
    """Return a line of each trace, broken where frames have no truth."""
    series = []
    for name, t in traces.items():
        cuts = np.flatnonzero(np.diff(t.frames) > 1) + 1
        series.append(_line(looks(name), np.insert(x(t), cuts, np.nan), np.insert(y(t), cuts, np.nan)))
    return series


def errors(traces: Traces, kind: int, unit: LengthUnit, looks: Looks = of_method) -> Markup:
    """Return a chart of errors of position (0, in `unit`) or rotation (1) over the distance travelled."""

    def size(trace: Trace) -> Array:
        return unit.per_m * trace.position_m if kind == 0 else trace.rotation_deg

    title, label = f"{KINDS[kind].capitalize()} error", (unit.name, "degrees")[kind]
    series = _of_traces(traces, looks, size, lambda t: t.distance_m)
    return draw(Chart(title, "distance travelled, m", label, series, "first poses aligned", zero=True))


def nees(traces: Traces, gaps: Sequence[int] = (), looks: Looks = of_method) -> Markup:
    """Return a chart of the NEES of the pose over the frames."""
    least = 0.1  # the smallest drawn value, as the first poses are exact by definition
    series = _of_traces(traces, looks, lambda t: np.maximum(t.nees, least), lambda t: t.frames.astype(float))
    note = "shaded: 95 % where the covariance holds; above: too small"
    return draw(
        Chart("NEES of the pose", "frame", "NEES", series, note, log_y=True, expected=NEES_INTERVAL, marks=gaps)
    )


def ratios(content: dict[str, Any]) -> Markup:
    """Return a chart of errors over those of the reference, with intervals; `content` of report.json."""
    rows = []
    for key, found in content["error_over_cross_frame"].items():
        look = of_method(key)
        for quantity, f in found.items():
            low, high = f["ci95"]
            rows.append(Row(f"{look.name}, {quantity}", f["value"], low, high, look.colour))
    return intervals(f"Errors over those of {REFERENCE}", "ratio", rows, "spans to a twentieth of the log, 95 %")


def innovations(runs: Iterable[RunRecord], gaps: Sequence[int] = ()) -> Markup:
    """Return a chart of the squared innovations per degree of freedom over the frames."""
    series = [_per_frame(run, run.nis_over_dof) for run in runs]
    title = "Squared innovations per degree of freedom"
    return draw(Chart(title, "frame", "NIS / dof", series, "1 expected", zero=True, marks=gaps))


def apart(runs: Sequence[RunRecord], gaps: Sequence[int], unit: LengthUnit) -> Markup:
    """Return a chart of the distance of positions from those of the reference, or else of the first method."""
    reference = next((r for r in runs if r.name == REFERENCE), runs[0])
    series = []
    for run in runs:
        n = min(len(run), len(reference))
        if run is not reference and n:
            d = run.poses[:n, :3, 3] - reference.poses[:n, :3, 3]
            series.append(_per_frame(run, unit.per_m * np.linalg.norm(d, axis=1)))
    title = f"Distance from {of_method(reference.name).name}"
    return draw(Chart(title, "frame", unit.name, series, "positions, not aligned", zero=True, marks=gaps))


def drift(content: dict[str, Any], kind: int, unit: LengthUnit) -> Markup:
    """Return a chart of RMS errors of relative motions over their span, position (0, in `unit`) or rotation (1).

    `content`: the section `drift` of report.json. Bands are 95 %; thin lines have the slopes of random walk and bias.
    """
    name, factor = (unit.name, unit.per_m) if kind == 0 else ("mrad", 1e3)
    key = f"{KINDS[kind]}_rms_{('m', 'rad')[kind]}"
    frames = np.array(content["curves"]["frames"], float)
    series = []
    for method, found in content["curves"]["methods"].items():
        if len(found[key]):
            value, low, high = factor * np.array(found[key], float).T
            look = of_method(method)
            series.append(Series(look.name, frames, value, look.colour, dots=True, band=(low, high)))
    of_what = "from halves of the tracks" if content["against"] == "halves" else "against the truth"
    note = f"{of_what}; shaded: 95 %; thin: slope ½, random walk, and 1, bias"
    title = f"{KINDS[kind].capitalize()} error of relative motions"
    return draw(Chart(title, "span, frames", name, series, note, log_x=True, log_y=True, slopes=(0.5, 1.0)))


def structure(runs: Sequence[RunRecord], unit: LengthUnit) -> Markup:
    """Chart the depth errors of local points over their σ if there are depth images, else σ along the rays."""
    found = {run.name: np.array(run.depth_rows).T for run in runs if run.depth_rows}
    if found:
        series = [_line(of_method(name), x, rms / np.maximum(std, 1e-12)) for name, (x, rms, std) in found.items()]
        title, label, note = "Depth error of local points", "RMS error / RMS σ", "over σ, 1 expected"
    else:
        series = [_per_frame(run, unit.per_m * run.column("sigma_local_m")) for run in runs]
        title, label, note = "σ of local points", f"along the ray, {unit.name}", "median"
    return draw(Chart(title, "frame", label, series, note, log_y=True))


def test_points(runs: Sequence[RunRecord], truth: Trajectory | None, unit: LengthUnit) -> list[Markup]:
    """Chart the errors of test points in the world, the paper's Figure 7 (c); nothing without depth images."""
    series = []
    for run in runs:
        if run.structure is None or truth is None:
            continue
        stamps_ns, error, _ = run.structure.test_points.errors(run.trajectory(), truth)
        frames, of_frame = np.unique(np.searchsorted(run.stamps_ns, stamps_ns), return_inverse=True)
        if len(frames):
            squares = np.bincount(of_frame, (error**2).sum(axis=1)) / np.bincount(of_frame)
            series.append(_line(of_method(run.name), frames.astype(float), unit.per_m * np.sqrt(squares)))
    title, note = "Error of test points in the world", "those in view, RMS; first poses aligned"
    return [draw(Chart(title, "frame", unit.name, series, note, zero=True))] if series else []


def lives(front: FrontRecord) -> Markup:
    """Return the lives of the tracks, the paper's Figure 3: one line per point, in order of the first frame."""
    spans = list(front.lives.values())
    if not spans:
        return Markup('<p class="none">No point was tracked.</p>')
    most = 1200  # lines; more are not distinguishable
    every = max(1, -(-len(spans) // most))
    shown = "one line each" if every == 1 else f"one line for {every}"
    note = f"{len(spans)} points, {shown}, seen in {front.tracks()['mean_frames']:.1f} frames in the mean"
    return lifetimes("Track lifetimes", spans[::every], note)


def _per_frame(run: RunRecord, y: Array) -> Series:
    return _line(of_method(run.name), np.arange(len(y), dtype=float), y)


def masks(rig: StereoRig | MonoRig) -> list[Markup]:
    """Return a picture of each camera's mask, with the parts of its images that are left out."""
    return [_mask(side, camera.mask) for side, camera in rig.cameras.items() if camera.mask is not None]


def _mask(side: str, mask: Mask) -> Markup:
    every = -(-mask.shape[1] // _CELLS)
    hidden = ~mask[::every, ::every]
    height, width = hidden.shape
    edges = np.diff(np.pad(hidden, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    begins, ends = np.argwhere(edges > 0), np.argwhere(edges < 0)[:, 1]
    path = "".join(f"M{x} {y}H{end}v1H{x}z" for (y, x), end in zip(begins.tolist(), ends.tolist(), strict=True))
    return Markup(
        '<figure><figcaption>mask of the {side} camera, {share} of its image</figcaption><svg viewBox="-1 -1 {w} {h}" '
        'role="img"><rect width="{width}" height="{height}" fill="none" stroke="currentColor" stroke-width=".3"/>'
        '<path d="{path}" fill="currentColor" opacity=".5"/></svg></figure>'
    ).format(
        side=side,
        share=f"{100 * (1 - mask.mean()):.0f} %",
        w=width + 2,
        h=height + 2,
        width=width,
        height=height,
        path=path,
    )
