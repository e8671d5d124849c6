"""What the commands print: progress and warnings on standard error, results on standard output."""

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..files import json_bytes

if TYPE_CHECKING:
    from ..pipeline.replay import ReplayResult
    from ..types import FrameEstimate


class Teller:
    """Called with each estimate: moves the bar and, if `status_changes`, tells when the status changes."""

    def __init__(self, console: Console, advance: Any = None) -> None:
        self.status_changes = False
        self._console, self._advance = console, advance
        self._status = ""

    def __call__(self, estimate: "FrameEstimate") -> None:
        """Take note of a frame."""
        if self._advance is not None:
            self._advance()
        if self.status_changes and estimate.status != self._status:
            reason = f": {estimate.reason}" if estimate.reason else ""
            self._console.print(f"frame {estimate.frame_index}: {estimate.status}{reason}", markup=False)
            self._status = estimate.status


def frames_to_come(expected: int | None, args: argparse.Namespace) -> int | None:
    """How many frames the bar should expect; None where it is not known."""
    if args.start is not None or args.end is not None or expected is None:
        return int(args.max_frames) if args.max_frames else None
    frames: int = min(-(-expected // args.stride), args.max_frames or expected)
    return 2 * frames - 1 if getattr(args, "there_and_back", False) else frames


@contextmanager
def progress(total: int | None, quiet: bool) -> Iterator[Teller]:
    """A bar on standard error while frames are estimated, on a terminal only."""
    console = Console(stderr=True)
    if quiet or not sys.stderr.isatty():
        yield Teller(console)
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("frames"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("frames", total=total)
        yield Teller(console, lambda: bar.advance(task))


@contextmanager
def counter(label: str, total: int, quiet: bool = False) -> Iterator[Callable[..., None] | None]:
    """A bar on standard error, on a terminal only: a function to call with the number of things just finished, and
    with a line to print above the bar if there is one; None where there is no bar."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(label, total=total)

        def advance(finished: int, line: str = "") -> None:
            if line:
                bar.console.print(line, markup=False, highlight=False)
            bar.advance(task, finished)

        yield advance


def print_json(value: Any) -> None:
    """One JSON object; NaN and infinity become null."""
    print(json_bytes(value).decode(), end="")


def print_replay(result: "ReplayResult", args: argparse.Namespace) -> None:
    """The summary of a replay as JSON or as a table, warnings on standard error."""
    summary = result.summary
    if not args.quiet:
        print_notes("warning", summary["warnings"])
    if args.json:
        print_json({**summary, "out": str(result.out_dir)})
        return
    if args.quiet:
        return
    frames, timing = summary["frames"], summary["timing_ms"]
    table = Table(title=escape(f"{summary['log']}: {summary['method']}"), title_justify="left", show_header=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    read = "" if summary["complete"] else ", log or run not complete"
    table.add_row("frames", f"{frames['estimated']} estimated of {frames['paired']} paired{read}")
    table.add_row("", f"{frames['degraded']} degraded, {frames['lost']} lost, {frames['dropped']} dropped")
    unit = "units" if summary["unscaled"] else "m"
    if summary["unscaled"]:
        table.add_row("unit of length", summary["unit_of_length"])
    table.add_row("path", f"{summary['path_length_m']:.3f} {unit} in {summary['duration_s']:.2f} s")
    total = timing["total"]
    if total["p50"] is not None:
        table.add_row("a frame takes", f"{total['p50']:.1f} ms (median), {total['p95']:.1f} ms (95 %)")
    if args.verbose:
        for stage in ("decode", "frontend", "estimator"):
            table.add_row(
                f"  {stage}", " / ".join(_number(timing[stage][k]) for k in ("p50", "p95", "max")) + " ms"
            )
    memory = f"{_number(summary['peak_rss_mib'], '.0f')} MiB"
    table.add_row("speed, CPU, memory", f"{summary['frames_per_s']:.1f} /s, {summary['cpu_s']:.1f} s, {memory}")
    if back := summary.get("there_and_back"):
        table.add_row(
            "there and back",
            f"ends {back['end_position_m']:.4g} {unit} from where it began, {back['end_drift_percent']:.3g} % of "
            f"{back['path_length_m']:.4g} {unit}",
        )
    for label, text in _truth_rows(summary.get("ground_truth")):
        table.add_row(label, text)
    table.add_row("results", escape(str(result.out_dir)))
    _console().print(table)


def _truth_rows(truth: dict[str, Any] | None) -> Iterator[tuple[str, str]]:
    if truth is None:
        return
    if "ate_rmse_sim3_m" in truth:
        share, unit_m = _number(truth["ate_sim3_percent"], ".3f"), _number(truth["metres_per_unit"], ".5g")
        yield "ATE after Sim(3)", f"{_number(truth['ate_rmse_sim3_m'], '.4f')} m, {share} % of the path"
        yield "one unit is", f"{unit_m} m, by the ground truth"
        return
    yield "ATE aligned", f"{_number(truth['ate_rmse_aligned_m'], '.4f')} m"
    yield "ATE, first poses aligned", f"{_number(truth['ate_rmse_m'], '.4f')} m"
    yield "final drift", f"{_number(truth['final_drift_percent'])} %"
    lengths = truth["segment_lengths_m"]
    over = f" over {lengths[0]:.3g}–{lengths[-1]:.3g} m" if lengths else ""
    t, r = _number(truth["t_rel_percent"]), _number(truth["r_rel_deg_per_100m"])
    yield "t_rel, r_rel", f"{t} %, {r} °/100 m{over}"
    yield "scale error", f"{_number(truth['scale_error_percent'], '+.2f')} %"
    yield "NEES of the pose", f"{_number(truth['nees_pose_mean'])} (6 expected)"
    if truth["local_structure_rms_m"] is not None:
        ratio = _number(truth["local_structure_error_over_sigma"])
        median, rms = (_number(truth[f"local_structure_{k}_m"], ".4f") for k in ("median", "rms"))
        yield "local structure", f"{median} m median, {rms} m RMS, {ratio} of the claimed σ"


def print_inspection(found: dict[str, Any]) -> None:
    """The description that `inspect_log` gives, for people."""
    console = _console()
    topics = Table(title=escape(found["log"]), title_justify="left")
    for heading in ("topic", "schema", "kind", "messages", "rate"):
        topics.add_column(heading, justify="right" if heading in ("messages", "rate") else "left", overflow="fold")
    for t in found["topics"]:
        rate = f"{t['rate_hz']:.1f} Hz" if t["rate_hz"] else ""
        count = "" if t["count"] is None else str(t["count"])
        topics.add_row(escape(t["topic"]), escape(t["schema"] or "–"), t["kind"] or "", count, rate)
    console.print(topics)
    lines = Table(show_header=False)
    lines.add_column(style="bold")
    lines.add_column(overflow="fold")
    for label, text in _inspection_rows(found):
        lines.add_row(label, escape(text))
    console.print(lines)
    print_notes("warning", found["warnings"], console)
    print_notes("problem", found["problems"], console)
    if not found["problems"]:
        console.print("a replay can use this log")


def _inspection_rows(found: dict[str, Any]) -> Iterator[tuple[str, str]]:
    pair, images, frames, rig, check = (found[k] for k in ("pair", "images", "frames", "rig", "calibration_check"))
    whole = "whole" if found["complete"] else "damaged or cut off"
    index = "indexed" if found["indexed"] else "without an index"
    length = f", {found['duration_s']:.2f} s" if found["duration_s"] is not None else ""
    yield "file", f"{found['size_bytes'] / 1e6:.2f} MB, {whole}, {index}{length}"
    if pair:
        yield "stereo pair", f"{pair['left']} and {pair['right']}: {pair['reason']}"
    if images:
        kinds = " and ".join(
            dict.fromkeys(f"{'×'.join(map(str, i['size'] or '?'))} {i['encoding']}" for i in images.values())
        )
        yield "images", kinds
    if frames:
        rate = f" at {frames['rate_hz']:.2f} Hz" if frames["rate_hz"] else ""
        exactly = f"{frames['paired_exactly']} by equal stamps"
        yield (
            "stereo frames",
            f"{frames['paired']}{rate}, {exactly}, median offset {_number(frames['median_offset_ms'])} ms",
        )
        yield (
            "left over",
            f"{frames['unpaired_left']} left and {frames['unpaired_right']} right images without a partner",
        )
        gaps = [f"{g['length_s']:.2f} s after {g['after_s']:.2f} s" for g in frames["gaps"][:5]]
        more = f" and {frames['gap_count'] - 5} more" if frames["gap_count"] > 5 else ""
        yield "gaps", "; ".join(gaps) + more if gaps else "none"
    if rig:
        yield (
            "calibration",
            f"{rig['source']}; for {'rectified' if rig['rectified_images'] else 'unrectified'} images",
        )
        yield (
            "rig",
            f"baseline {rig['baseline_m']:.4f} m, focal length {rig['focal_px'][0]:.1f} px, vergence "
            f"{rig['vergence_deg']:.2f}°, distortion {rig['distortion_model'][0]}",
        )
    if check and check["vertical_px"] is not None:
        yield (
            "calibration check",
            f"{check['matches']} matched corners: rows differ by {check['vertical_px']:+.2f} ± "
            f"{check['vertical_spread_px']:.2f} px, median disparity {check['median_disparity_px']:.1f} px",
        )
    depth = f", depth on {found['ground_truth_depth']}" if found["ground_truth_depth"] else ""
    yield "ground truth", f"{found['ground_truth'] or 'none'}{depth}"


def print_notes(kind: str, notes: list[str], console: Console | None = None) -> None:
    """One line each, on standard error unless a console is given."""
    for note in notes:
        (console or Console(stderr=True, soft_wrap=True)).print(f"{kind}: {note}", markup=False, highlight=False)


def _console() -> Console:
    return Console(width=None if sys.stdout.isatty() else 110)


def _number(value: Any, form: str = ".2f") -> str:
    if value is None:
        return "–"
    return format(value, form) if isinstance(value, int | float) and not isinstance(value, bool) else str(value)
