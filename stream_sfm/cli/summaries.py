"""The summaries of replays, comparisons and batches as tables."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ..wording import printable
from .printing import broken_at, factors_text, interval, number, print_table

# Keys of the section `ground_truth` of a summary, and of a method in report.json: heading and format.
_ERRORS = {
    "ate_rmse_aligned_m": ("ATE aligned\nm", ".3g"),
    "ate_rmse_m": ("ATE\nm", ".3g"),
    "final_drift_percent": ("drift\n%", ".3g"),
    "t_rel_percent": ("t_rel\n%", ".3g"),
    "r_rel_deg_per_100m": ("r_rel\n°/100 m", ".3g"),
    "scale_error_percent": ("scale\n%", "+.2f"),
    "nees_pose_mean": ("NEES", ".3g"),
}
_OF_RUNS = {
    **_ERRORS,
    "relative_motion_over_sigma": ("motion\nover σ", ".3g"),
    "ate_rmse_sim3_m": ("ATE, Sim(3)\nm", ".3g"),
    "metres_per_unit": ("one unit\nm", ".4g"),
}
_OF_METHODS = {
    **{key: _ERRORS[key] for key in _ERRORS if key not in ("ate_rmse_m", "scale_error_percent")},
    "ms_per_frame_p50": ("time\nms/frame", ".4g"),
}
_WITHOUT_TRUTH = {
    "divergence_from_cross_frame_m": ("away from\ncross-frame m", ".3g"),
    "end_std_position_m": ("σ at the\nend m", ".3g"),
    "end_std_heading_deg": ("σ of the\nheading °", ".2g"),
    "nis_over_dof": ("NIS\n1 expected", ".3g"),
    "ms_per_frame_p50": ("time\nms/frame", ".4g"),
}
_NAME_WIDTH, _EVALUATION_WIDTH = 28, 130  # characters of the name of a run; columns of a table in a pipe
_OF_BATCH = ("ate_rmse_aligned_m", "final_drift_percent", "t_rel_percent")


def print_summary(summary: dict[str, Any], folder: Path | None, stages: bool) -> None:
    """Print the summary of a replay and where the results are; `stages` adds the time that each stage takes."""
    rows = [*_run_rows(summary, stages), *_truth_rows(summary.get("ground_truth")), ("results", str(folder))]
    print_table(rows, title=f"{summary['log']}: {summary['method']}")


def print_comparison(content: dict[str, Any]) -> None:
    """Print the methods of report.json; a figure that does not exist for this log is a dash."""
    ratios = content["error_over_cross_frame"]
    columns = _OF_METHODS if content["frames_with_ground_truth"] else _WITHOUT_TRUTH
    rows = [[key.replace("_", "-"), *_cells(figures, columns)] for key, figures in content["methods"].items()]
    headings = ["method", *_headings(columns)]
    if ratios:
        headings.append("position error\nover cross-frame")
        for row, key in zip(rows, content["methods"], strict=True):
            ratio = ratios.get(key, {}).get("position")
            row.append(interval(ratio["value"], *ratio["ci95"]) if ratio else "–")
    print_table(rows, headings)
    for name, spans in (content["self_test"] or {}).items():
        print(f"halves of the {name} differ by {factors_text(spans)}")


def print_evaluation(runs: Sequence[dict[str, Any]]) -> None:
    """Print the runs of `evaluate`, one row each, with the figures that any of them has."""
    rows, told = [], [run["ground_truth"] | _over_sigma(run["ground_truth"]) for run in runs]
    columns = {key: _OF_RUNS[key] for key in _OF_RUNS if any(key in figures for figures in told)}
    for run, figures in zip(runs, told, strict=True):
        name = broken_at(run["run"], "/._-", _NAME_WIDTH)
        rows.append([name, run["method"], str(figures["frames_compared"]), *_cells(figures, columns)])
    headings = ["run", "method", "frames", *_headings(columns)]
    print_table(rows, headings, width=_EVALUATION_WIDTH, text_columns=2)


def print_batch(content: dict[str, Any], folder: Path) -> None:
    """Print the logs of batch.json, one row each, how many are done, and where the page is."""
    from ..report.pages import conclusion

    rows = []
    for log in content["logs"]:
        rows.append([log["name"], log["status"]])
        if summary := log["summary"]:
            frames, truth = summary["frames"], summary.get("ground_truth", {})
            figures = [summary["path_length_m"], *map(truth.get, _OF_BATCH), summary["timing_ms"]["total"]["p50"]]
            rows[-1] += [str(frames["estimated"]), str(frames["lost"]), *(number(f, ".3g") for f in figures)]
    errors = (_ERRORS[key][0].replace(" aligned", "") for key in _OF_BATCH)
    print_table(rows, ["log", "status", "frames", "lost", "path\nm", *errors, "time\nms/frame"], text_columns=2)
    print(f"{conclusion(content)}\n{printable(str(folder / 'report.html'))}")


Columns = dict[str, tuple[str, str]]


def _over_sigma(figures: dict[str, Any]) -> dict[str, float]:
    """The error of the relative motion over its σ, over the shortest span."""
    spans = figures.get("relative_consistency")
    return {"relative_motion_over_sigma": spans[0]["factor"]} if spans else {}


def _headings(columns: Columns) -> Iterator[str]:
    return (heading for heading, _ in columns.values())


def _cells(figures: dict[str, Any], columns: Columns) -> Iterator[str]:
    return (number(figures.get(key), form) for key, (_, form) in columns.items())


def _run_rows(summary: dict[str, Any], stages: bool) -> Iterator[tuple[str, str]]:
    frames, timing = summary["frames"], summary["timing_ms"]
    incomplete = "" if summary["complete"] else ", incomplete"
    yield "frames", f"{frames['estimated']} estimated of {frames['paired']} paired{incomplete}"
    yield "", f"{frames['degraded']} degraded, {frames['lost']} lost, {frames['dropped']} dropped"
    unit = "units" if summary["unscaled"] else "m"
    if summary["unscaled"]:
        yield "unit of length", summary["unit_of_length"]
    yield "path", f"{summary['path_length_m']:.3f} {unit} in {summary['duration_s']:.2f} s"
    if timing["total"]["p50"] is not None:
        yield "time per frame", _milliseconds(timing["total"])
    for stage in ("decode", "frontend", "estimator") if stages else ():
        yield f"  {stage}", _milliseconds(timing[stage])
    memory = number(summary["peak_rss_mib"], ".0f")
    yield "speed", f"{summary['frames_per_s']:.1f} frames/s, {summary['cpu_s']:.1f} s of CPU time, {memory} MiB"
    if end := summary.get("end"):
        x, y, z = end["position_m"]
        share = f", {end['std_position_percent']:.2g} % of the path" if end["std_position_percent"] else ""
        yield "ends at", f"({x:.3f}, {y:.3f}, {z:.3f}) m, σ {end['std_position_m']:.2g} m{share}"
        yield "", f"heading {end['heading_deg']:.2f}°, σ {end['std_heading_deg']:.2g}°"
    if rig := summary.get("rig"):
        yield "calibration", rig["text"]
    if imu := summary.get("imu"):
        yield "inertia", f"{imu['frames']} frames, {imu['dead_reckoned']} of them by the IMU alone"
        tilt, lengths = 1e3 * imu["std_tilt_rad"], imu["std_scale_percent"]
        yield "", f"tilt σ {tilt:.2g} mrad, lengths {imu['scale_percent']:+.2f} %, σ {lengths:.2g} %"
        offset_ms, std_ms = 1e3 * imu["time_offset_s"], 1e3 * imu["std_time_offset_s"]
        yield "", f"its clock {offset_ms:+.2f} ms, σ {std_ms:.2g} ms"
    for name, spans in summary.get("self_test", {}).items():
        yield f"halves of the {name}", f"differ by {factors_text(spans)}"
    if places := summary.get("map"):
        yield "loops", places["problem"] or f"{places['loops']} over {places['keyframes']} keyframes"
        if truth := places.get("ground_truth"):
            ate, aligned = (number(truth[key], ".3g") for key in ("ate_rmse_m", "ate_rmse_aligned_m"))
            yield "", f"ATE {ate} m, aligned {aligned} m"


def _truth_rows(truth: dict[str, Any] | None) -> Iterator[tuple[str, str]]:
    if truth is None:
        return

    def shown(key: str, form: str = ".2f") -> str:
        return number(truth[key], form)

    if "ate_rmse_sim3_m" in truth:
        percent = shown("ate_sim3_percent", ".3f")
        yield "ATE after Sim(3)", f"{shown('ate_rmse_sim3_m', '.4f')} m, {percent} % of the path"
        yield "one unit", f"{shown('metres_per_unit', '.5g')} m, from the ground truth"
        return
    yield "ATE aligned", f"{shown('ate_rmse_aligned_m', '.4f')} m"
    yield "ATE, first poses aligned", f"{shown('ate_rmse_m', '.4f')} m"
    yield "final drift", f"{shown('final_drift_percent')} %"
    lengths = truth["segment_lengths_m"]
    over = f" over {lengths[0]:.3g}–{lengths[-1]:.3g} m" if lengths else ""
    yield "t_rel, r_rel", f"{shown('t_rel_percent')} %, {shown('r_rel_deg_per_100m')} °/100 m{over}"
    yield "scale error", f"{shown('scale_error_percent', '+.2f')} %"
    if truth["relative_consistency"]:
        yield "relative motion", f"error of {factors_text(truth['relative_consistency'])}"
    yield "NEES of the pose", f"{shown('nees_pose_mean')} (expected: 6)"
    if truth["local_structure_rms_m"] is not None:
        median, rms = (shown(f"local_structure_{kind}_m", ".4f") for kind in ("median", "rms"))
        over, usual = (shown(f"local_structure_error_over_sigma{kind}") for kind in ("", "_median"))
        beyond = f"{shown('local_structure_beyond_3_sigma_percent')} % beyond 3 (expected: 0.27 %)"
        yield "local structure", f"{median} m median error, {rms} m RMS, {over} × the estimated σ"
        yield "in units of σ", f"{usual} median (expected: 0.67), {beyond}"


def _milliseconds(times: dict[str, float | None]) -> str:
    p50, p95, most = (number(times[k], ".1f") for k in ("p50", "p95", "max"))
    return f"{p50} ms median, {p95} ms 95th percentile, {most} ms maximum"
