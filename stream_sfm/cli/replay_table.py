"""The summary of a replay as a table."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich.markup import escape

from ..wording import printable
from .printing import factors_text, facts_table, number, stdout_console


def print_summary(summary: dict[str, Any], folder: Path | None, stages: bool) -> None:
    """Print the summary and where the results are; `stages` adds the time that each stage takes."""
    table = facts_table(escape(printable(f"{summary['log']}: {summary['method']}")))
    for label, text in (
        *_run_rows(summary, stages),
        *_truth_rows(summary.get("ground_truth")),
    ):
        table.add_row(label, text)
    table.add_row("results", escape(printable(str(folder))))
    stdout_console().print(table)


def _run_rows(summary: dict[str, Any], stages: bool) -> Iterator[tuple[str, str]]:
    frames, timing = summary["frames"], summary["timing_ms"]
    incomplete = "" if summary["complete"] else ", incomplete"
    there = frames["estimated"] - frames["backwards"]
    once_more = f", then {frames['backwards']} backwards" if frames["backwards"] else ""
    yield "frames", f"{there} estimated of {frames['paired']} paired{once_more}{incomplete}"
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
    for name, spans in summary.get("self_test", {}).items():
        yield f"halves of the {name}", f"differ by {factors_text(spans)}"
    if back := summary.get("there_and_back"):
        yield (
            "there and back",
            f"ends {back['end_position_m']:.4g} {unit} from its start, {back['end_drift_percent']:.3g} % of "
            f"{back['path_length_m']:.4g} {unit}",
        )


def _truth_rows(truth: dict[str, Any] | None) -> Iterator[tuple[str, str]]:
    if truth is None:
        return
    if "ate_rmse_sim3_m" in truth:
        percent, unit_m = number(truth["ate_sim3_percent"], ".3f"), number(truth["metres_per_unit"], ".5g")
        yield "ATE after Sim(3)", f"{number(truth['ate_rmse_sim3_m'], '.4f')} m, {percent} % of the path"
        yield "one unit", f"{unit_m} m, from the ground truth"
        return
    yield "ATE aligned", f"{number(truth['ate_rmse_aligned_m'], '.4f')} m"
    yield "ATE, first poses aligned", f"{number(truth['ate_rmse_m'], '.4f')} m"
    yield "final drift", f"{number(truth['final_drift_percent'])} %"
    lengths = truth["segment_lengths_m"]
    over = f" over {lengths[0]:.3g}–{lengths[-1]:.3g} m" if lengths else ""
    t, r = number(truth["t_rel_percent"]), number(truth["r_rel_deg_per_100m"])
    yield "t_rel, r_rel", f"{t} %, {r} °/100 m{over}"
    yield "scale error", f"{number(truth['scale_error_percent'], '+.2f')} %"
    if truth["relative_consistency"]:
        yield "relative motion", f"error of {factors_text(truth['relative_consistency'])}"
    yield "NEES of the pose", f"{number(truth['nees_pose_mean'])} (expected: 6)"
    if truth["local_structure_rms_m"] is not None:
        ratio = number(truth["local_structure_error_over_sigma"])
        median, rms = (number(truth[f"local_structure_{k}_m"], ".4f") for k in ("median", "rms"))
        yield "local structure", f"{median} m median error, {rms} m RMS, {ratio} × the estimated σ"
        half = number(truth["local_structure_error_over_sigma_median"])
        beyond = number(truth["local_structure_beyond_3_sigma_percent"])
        yield "in units of σ", f"{half} median (expected: 0.67), {beyond} % beyond 3 (expected: 0.27 %)"


def _milliseconds(times: dict[str, float | None]) -> str:
    p50, p95, most = (number(times[k], ".1f") for k in ("p50", "p95", "max"))
    return f"{p50} ms median, {p95} ms 95th percentile, {most} ms maximum"
