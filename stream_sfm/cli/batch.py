"""`stream-sfm batch`: many logs in parallel, a folder of results each, one table and one page."""

import argparse
import sys
from pathlib import Path
from typing import Any

from ..errors import ExitCode
from . import arguments


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "batch",
        help="replay many logs in parallel: a folder each, one table and one HTML page",
        description="Replay many logs in parallel, each in a process of its own: one that fails, crashes or hangs "
        "does not harm the others. Writes a folder a log as `replay` does, batch.json, and report.html (one file, no "
        "network). Called again it does only what is missing or has changed.",
    )
    parser.add_argument("logs", nargs="+", metavar="LOG", help="stereo logs (MCAP), folders of them, or patterns")
    parser.add_argument("--out", metavar="DIR", required=True, help="folder of the results, one folder a log in it")
    arguments.add_workers(parser)
    parser.add_argument(
        "--timeout",
        type=arguments.seconds,
        default=600.0,
        metavar="S",
        help="give a log up that yields no frame for so many seconds (default 600)",
    )
    arguments.add_method(parser)
    arguments.add_cameras(parser)
    arguments.add_selection(parser)
    arguments.add_configuration(parser)
    parser.add_argument("--json", action="store_true", help="print batch.json, nothing else")
    parser.add_argument("-q", "--quiet", action="store_true", help="print errors only")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Replay all logs, print a table, and say by the exit code whether all of them are done."""
    from concurrent.futures import ThreadPoolExecutor

    from ..batch.collect import run_batch
    from ..batch.logs import find_logs
    from ..camera.rig import StereoRig
    from ..executors import cluster
    from ..pipeline.replay import check_selection
    from . import output

    config = arguments.read_settings(args)
    config.needs_scale("batch, which compares metres,")
    check_selection(args.start, args.end)
    calibration = Path(args.calibration).resolve() if args.calibration else None
    if calibration is not None:
        StereoRig.from_calibration(calibration)  # a mistake in it is said once, and before anything is begun
    logs = find_logs(args.logs)
    out = Path(args.out)
    with (
        # The threads only wait for the processes that replay.
        cluster(args.scheduler) if args.scheduler else ThreadPoolExecutor(args.workers) as executor,
        output.counter("logs", len(logs), args.quiet) as advance,
    ):
        content = run_batch(
            logs,
            out,
            config,
            executor,
            options=arguments.selection_options(args),
            calibration=calibration,
            patience_s=args.timeout,
            on_done=lambda outcome: advance(1, f"{outcome.name}: {outcome.status}") if advance else None,
        )
    if args.json:
        output.print_json(content)
    elif not args.quiet:
        _print(content, out)
    for log in content["logs"]:
        if log["status"] != "done":
            print(f"stream-sfm: {log['name']}: {log['status']}: {log['reason']}", file=sys.stderr)
    if content["interrupted"]:
        return ExitCode.INTERRUPTED
    return ExitCode.DONE if content["complete"] else ExitCode.INPUT


def _print(content: dict[str, Any], out: Path) -> None:
    from rich import box
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from ..report.batch_page import verdict

    truth_columns = {"ate_rmse_aligned_m": "ATE\nm", "final_drift_percent": "drift\n%", "t_rel_percent": "t_rel\n%"}
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)  # it fits into 80 columns
    table.add_column("log", overflow="fold", min_width=8)
    table.add_column("status", no_wrap=True)
    for heading in ("frames", "lost", "path\nm", *truth_columns.values(), "a frame\nms"):
        table.add_column(heading, justify="right", no_wrap=True)
    for log in content["logs"]:
        summary = log["summary"]
        if summary is None:
            table.add_row(escape(log["name"]), log["status"])
            continue
        frames, truth = summary["frames"], summary.get("ground_truth", {})
        figures = [summary["path_length_m"], *map(truth.get, truth_columns), summary["timing_ms"]["total"]["p50"]]
        cells = ("–" if figure is None else f"{figure:.3g}" for figure in figures)
        table.add_row(escape(log["name"]), log["status"], str(frames["estimated"]), str(frames["lost"]), *cells)
    Console(width=None if sys.stdout.isatty() else 120).print(table)
    print(verdict(content))
    print(out / "report.html")
