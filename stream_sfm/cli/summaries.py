"""The summaries of replays, comparisons and batches as tables."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..system.wording import counted, printable
from .printing import broken_at, factors_text, number, print_table

if TYPE_CHECKING:
    from ..evaluation.figures import Figure, LengthUnit

_UNKNOWN_DEG = 100.0  # σ of a heading that may be any one
_NAME_WIDTH, _EVALUATION_WIDTH = 28, 130  # characters of the name of a run; columns of a table in a pipe


def print_summary(summary: dict[str, Any], folder: Path | None, stages: bool) -> None:
    """Print the summary of a replay and the place of the results; `stages` adds the time of each stage."""
    rows = [*_run_rows(summary, stages), *_truth_rows(summary.get("ground_truth")), ("results", str(folder))]
    print_table(rows, title=f"{summary['log']}: {summary['method']}")
    if rig := summary.get("rig"):
        print(f"calibration: {rig['text']}")


def print_comparison(content: dict[str, Any]) -> None:
    """Print the conclusion and the methods of report.json; an undefined figure is a dash."""
    from ..evaluation.figures import TIME, units_of
    from ..report.numbers import figures_of
    from ..report.tables import of_method

    print(content["conclusion"])
    keys, methods = list(content["methods"]), list(content["methods"].values())
    figures = figures_of(content)
    headings, cells = _columns((*figures, *TIME), methods, units_of(methods, figures))
    names = [of_method(key).name for key in keys]
    print_table([[name, *row] for name, row in zip(names, cells, strict=True)], ["method", *headings])
    if lines := content["drift"]["table"]:
        _print_drift(content["drift"], lines, dict(zip(keys, names, strict=True)))
    for name, spans in (content["self_test"] or {}).items():
        print(f"halves of the {name} differ by {factors_text(spans)}")


def _print_drift(drift: dict[str, Any], lines: list[dict[str, Any]], names: dict[str, str]) -> None:
    """Print the error of each method over each span, its ratio to the reference, and the factor of its σ."""
    from ..evaluation.figures import number_text, unit_for
    from ..report.tables import sigma_text

    unit = unit_for([of["position_rms_m"] for line in lines for of in line["methods"].values()])
    rows = []
    for key, name in names.items():
        rows.append([name])
        for line in lines if key in lines[0]["methods"] else ():
            of = line["methods"][key]
            ratio, factor = of.get(f"position_over_{drift['reference']}"), sigma_text(of)
            text = [number_text(of["position_rms_m"], unit.per_m)]
            if ratio is not None:
                mark = "*" if of["position_from_halves"] else ""
                text.append(f"×{ratio['value']:.2f}{mark}")
                text += ["[{:.2f}, {:.2f}]".format(*ratio["ci95"])] if ratio["ci95"] else []
            rows[-1].append("\n".join([*text, *([factor] if factor else [])]))
    headings = [f"{counted(line['frames'], 'frame')}\n{unit.name}" for line in lines]
    print_table(rows, ["position error over", *headings])
    if any(of["position_from_halves"] for line in lines for of in line["methods"].values()):
        print("* the ground truth cannot separate the methods here: ratio from halves of the tracks")


def print_over_logs(content: dict[str, Any]) -> None:
    """Print the conclusion of several logs, and the ratios of errors to those of the window with their intervals."""
    from ..evaluation.drift import KINDS
    from ..report.tables import of_method

    print(content["conclusion"])
    if not content["verdict"]:
        return
    headings = ["all spans", *(counted(line["frames"], "frame") for line in content["table"])]
    rows = []
    for key, ratios in content["verdict"]["ratios"].items():
        for kind in KINDS:
            cells = [ratios, *(line["methods"].get(key) for line in content["table"])]
            texts = [
                "–" if of is None else "×{:.2f}\n[{:.2f}, {:.2f}]".format(of[kind]["value"], *of[kind]["ci95"])
                for of in cells
            ]
            rows.append([f"{of_method(key).name}, {kind}", *texts])
    print_table(rows, [f"over {of_method('cross-frame').name}, {counted(len(content['logs']), 'log')}", *headings])


def print_evaluation(runs: Sequence[dict[str, Any]]) -> None:
    """Print the runs of `evaluate`, one row each, with all figures that any of them has."""
    from ..evaluation.figures import ABSOLUTE, ACCURACY, CONSISTENCY, OF_RUNS, units_of

    figures = (ACCURACY[0], ABSOLUTE[0], *ACCURACY[1:], *ABSOLUTE[1:], *CONSISTENCY, *OF_RUNS)
    errors = [run["ground_truth"] for run in runs]
    shown = [figure for figure in figures if any(of.get(figure.key) is not None for of in errors)]
    headings, cells = _columns(shown, errors, units_of(errors, shown))
    rows = [
        [broken_at(run["run"], "/._-", _NAME_WIDTH), run["method"], str(of["frames_compared"]), *row]
        for run, of, row in zip(runs, errors, cells, strict=True)
    ]
    print_table(rows, ["run", "method", "frames", *headings], width=_EVALUATION_WIDTH, text_columns=2)


def print_batch(content: dict[str, Any], folder: Path) -> None:
    """Print the logs of batch.json, one row each, the number of finished ones, and the place of the page."""
    from ..evaluation.figures import ACCURACY, Figure, units_of
    from ..report.pages import conclusion

    figures = (Figure("path_length_m", "path", "m"), *ACCURACY[:3], Figure("p50", "time", "ms/frame"))
    summaries = [log["summary"] for log in content["logs"] if log["summary"]]
    values = [s | s.get("ground_truth", {}) | s["timing_ms"]["total"] for s in summaries]
    headings, cells = _columns(figures, values, units_of(values, figures))
    rows, found = [], iter(zip(summaries, cells, strict=True))
    for log in content["logs"]:
        rows.append([log["name"], log["status"]])
        if log["summary"]:
            summary, row = next(found)
            rows[-1] += [str(summary["frames"]["estimated"]), str(summary["frames"]["lost"]), *row]
    print_table(rows, ["log", "status", "frames", "lost", *headings], text_columns=2)
    print(f"{conclusion(content)}\n{printable(str(folder / 'report.html'))}")


def _columns(
    figures: "Sequence[Figure]", runs: Sequence[dict[str, Any]], units: "dict[str, LengthUnit]"
) -> tuple[list[str], list[list[str]]]:
    """Return headings of the figures with units, and the cells of each run; a missing figure is a dash."""
    from ..evaluation.figures import LengthUnit, number_text

    found = [units.get(figure.unit, LengthUnit(figure.unit, 1.0)) for figure in figures]
    headings = ["\n".join(filter(None, (*f.name.split(), u.name))) for f, u in zip(figures, found, strict=True)]
    rows = []
    for run in runs:
        values = [run.get(figure.key) for figure in figures]
        rows.append(["–" if v is None else number_text(v, u.per_m) for v, u in zip(values, found, strict=True)])
    return headings, rows


def _run_rows(summary: dict[str, Any], stages: bool) -> Iterator[tuple[str, str]]:
    from ..report.records import OF_RUN

    frames, timing = summary["frames"], summary["timing_ms"]
    incomplete = "" if summary["complete"] else ", incomplete"
    yield "frames", f"{frames['estimated']} estimated of {frames['paired']} paired{incomplete}"
    yield "", f"{frames['degraded']} degraded, {frames['lost']} lost, {frames['dropped']} dropped"
    length = "units" if summary["unscaled"] else "m"
    if summary["unscaled"]:
        yield "unit of length", summary["unit_of_length"]
    for figure, _, row, _ in OF_RUN:
        if row and summary[figure.key] is not None:
            yield figure.name, row.format(length=length, **summary)
    if timing["total"]["p50"] is not None:
        waited = ", the wait for the camera included" if summary.get("live") else ""
        yield "time per frame", _milliseconds(timing["total"]) + waited
    for stage in ("decode", "frontend", "estimator") if stages else ():
        yield f"  {stage}", _milliseconds(timing[stage])
    if live := summary.get("live"):
        p50, p99, most = (number(live["latency_ms"][key], ".0f") for key in ("p50", "p99", "max"))
        yield "latency", f"{p50} ms median, {p99} ms in 99 %, {most} ms at most; {live['left_out']} pairs left out"
    memory = number(summary["peak_rss_mib"], ".0f")
    yield "speed", f"{summary['frames_per_s']:.1f} frames/s, {summary['cpu_s']:.1f} s of CPU time, {memory} MiB"
    if end := summary.get("end"):
        yield from _end_rows(end)
    if imu := summary.get("imu"):
        from ..report.inertia import inertial_rows

        yield from inertial_rows(imu)
    for name, spans in summary.get("self_test", {}).items():
        half, _, calibrated = name.partition("_")
        if spans or not calibrated:
            calibration = ", with one calibration" if calibrated else ""
            of_rig = spans[-1].get("factor_common") if spans else None
            rigs = "" if of_rig is None else f", their rigs by {of_rig:.2f} ×"
            yield f"halves of the {half}", f"differ by {factors_text(spans)}{calibration}{rigs}"
    if back := summary.get("there_and_back"):
        share = f" ({back['apart_percent']:.2g} % of the path)" if back["apart_percent"] is not None else ""
        yield (
            "there and back",
            f"ends {back['apart_m']:.3g} m{share} and {back['apart_deg']:.2g}° from its beginning",
        )
        yield "", f"{back['over_sigma']:.2f} × the estimated σ; {back['lost']} frames lost on the way back"
    if places := summary.get("map"):
        yield "loops", places["problem"] or f"{places['loops']} over {places['keyframes']} keyframes"
        if truth := places.get("ground_truth"):
            ate, aligned = (number(truth[key], ".3g") for key in ("ate_rmse_m", "ate_rmse_aligned_m"))
            yield "", f"ATE {ate} m, aligned {aligned} m"


def _end_rows(end: dict[str, Any]) -> Iterator[tuple[str, str]]:
    x, y, z = end["position_m"]
    percent, std_deg = end["std_position_percent"], end["std_heading_deg"]
    share = "" if not percent else f", {percent:.2g} % of the path" if percent < 100 else ", more than the path"
    known = "unknown" if percent is not None and percent >= 100 else f"({x:.3f}, {y:.3f}, {z:.3f}) m"
    yield "ends at", f"{known}, σ {end['std_position_m']:.2g} m{share}"
    known = f"{end['heading_deg']:.2f}°, σ {std_deg:.2g}°" if std_deg < _UNKNOWN_DEG else "unknown"
    yield "", f"heading {known}"


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
    if axes := truth.get("ate_axes_m"):  # runs of earlier versions have none
        yield "  right, down, forwards", ", ".join(f"{axis:.4f}" for axis in axes) + " m"
    yield "final drift", f"{shown('final_drift_percent')} %"
    lengths = truth["segment_lengths_m"]
    over = f" over {lengths[0]:.3g}–{lengths[-1]:.3g} m" if lengths else ""
    yield "t_rel, r_rel", f"{shown('t_rel_percent')} %, {shown('r_rel_deg_per_100m')} °/100 m{over}"
    yield "scale error", f"{shown('scale_error_percent', '+.2f')} %"
    if truth["relative_consistency"]:
        yield "relative motion", f"error of {factors_text(truth['relative_consistency'])}"
        yield from _parts_rows(truth)
    exact = "" if any(truth["std_truth"]) else ", against a truth taken as exact"
    yield "NEES of the pose", f"{shown('nees_pose_mean')} (expected: 6){exact}"
    if truth["local_structure_rms_m"] is not None:
        median, rms = (shown(f"local_structure_{kind}_m", ".4f") for kind in ("median", "rms"))
        over, usual = (shown(f"local_structure_error_over_sigma{kind}") for kind in ("", "_median"))
        beyond = f"{shown('local_structure_beyond_3_sigma_percent')} % beyond 3 (expected: 0.27 %)"
        yield "local structure", f"{median} m median error, {rms} m RMS, {over} × the estimated σ"
        yield "in units of σ", f"{usual} median (expected: 0.67), {beyond}"
    if truth.get("global_structure_rms_m") is not None:
        rms, over = shown("global_structure_rms_m", ".4f"), shown("global_structure_error_over_sigma")
        yield "test points in the world", f"{rms} m RMS, {over} × the estimated σ"


def _parts_rows(truth: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield σ in two figures: own errors of the motions, and errors of the rig; nothing where there is only one."""
    if truth.get("rig_over_sigma") is None:  # an exact rig, or a run of an earlier version
        return
    known = [span for span in truth["relative_consistency"] if span["factor_own"] is not None]
    yield "  own part", f"{factors_text(known, 'factor_own')}, given the rig"
    yield "  errors of the rig", f"{truth['rig_over_sigma']:.2f} × their estimated σ, once per run"


def _milliseconds(times: dict[str, float | None]) -> str:
    p50, p95, most = (number(times[k], ".1f") for k in ("p50", "p95", "max"))
    return f"{p50} ms median, {p95} ms 95th percentile, {most} ms maximum"
