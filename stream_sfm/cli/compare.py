"""`stream-sfm compare`: every method on the same observations, and the drift report."""

import argparse
import sys
from pathlib import Path
from typing import Any

from ..errors import ExitCode
from . import arguments


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "compare",
        help="how the EKF and the cross-frame method drift on a log: an HTML report",
        description="Run the cross-frame method (joint, per-point WC, per-point CC), the EKF and frame-to-frame on "
        "the same observations. Writes report.html (one file, no network), report.json, and a folder a method as "
        "`replay` does.",
    )
    arguments.add_log(parser)
    parser.add_argument("--out", metavar="DIR", help="folder of the results (default runs/<log>-<time>)")
    parser.add_argument(
        "--methods",
        metavar="NAME,…",
        help="default cross-frame,cross-frame-wc,cross-frame-cc,ekf,ekf-cv,frame-to-frame",
    )
    parser.add_argument(
        "--there-and-back",
        choices=("auto", "yes", "no"),
        default="auto",
        help="feed the frames backwards as well (auto: where the log has no ground truth)",
    )
    arguments.add_selection(parser)
    arguments.add_configuration(parser)
    parser.add_argument("--json", action="store_true", help="print report.json, nothing else")
    parser.add_argument("-q", "--quiet", action="store_true", help="print errors only")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Compare, print a table, and say by the exit code whether all of the log and all methods went through."""
    from ..comparison.compare import COMPARED, Selection
    from ..comparison.files import compare_into
    from ..config import read_config
    from ..inspection import inspect_log
    from ..pipeline.replay import check_selection, new_run_folder, point_latest_to
    from ..recording import open_log
    from . import output

    methods = (
        tuple(dict.fromkeys(m.strip() for m in args.methods.split(",") if m.strip())) if args.methods else COMPARED
    )
    config = read_config(args.config, args.set)
    check_selection(args.start, args.end)
    log = open_log(args.log, args.left, args.right, args.calibration)
    health = inspect_log(args.log, args.left, args.right, args.calibration)
    folder = Path(args.out) if args.out else new_run_folder(args.log)
    chosen = Selection(args.start, args.end, args.max_frames, args.stride)
    with output.progress(output.frames_to_come(log.expected_frames, args), args.quiet) as tell:
        comparison, content = compare_into(
            log,
            folder,
            config,
            methods,
            None if chosen == Selection() else chosen,
            there_and_back={"auto": None, "yes": True, "no": False}[args.there_and_back],
            health=health,
            on_frame=tell,
        )
    if not args.out:
        point_latest_to(folder)
    if args.json:
        output.print_json(content)
    elif not args.quiet:
        output.print_notes("warning", comparison.warnings)
        _print(content, folder)
    if comparison.interrupted:
        return ExitCode.INTERRUPTED
    if any(r.failure for r in comparison.runs):
        return ExitCode.DEFECT
    return ExitCode.DONE if comparison.complete else ExitCode.INPUT


def _print(content: dict[str, Any], folder: Path) -> None:
    from rich.console import Console
    from rich.table import Column, Table

    from ..report.numbers import verdict

    columns = {
        "ate_rmse_aligned_m": "ATE aligned, m",
        "final_drift_percent": "final drift, %",
        "t_rel_percent": "t_rel, %",
        "r_rel_deg_per_100m": "r_rel, °/100 m",
        "nees_pose_mean": "NEES",
        "growth_exponent": "growth",
        "ms_per_frame_p50": "ms a frame",
    }
    table = Table(*(Column(name, no_wrap=True) for name in ("method", *columns.values())))
    for key, figures in content["methods"].items():
        cells = ("–" if figures[c] is None else f"{figures[c]:.4g}" for c in columns)
        table.add_row(key.replace("_", "-"), *cells)
    console = Console(width=None if sys.stdout.isatty() else 120)
    console.print(table)
    print(verdict(content, bool(content["frames_with_ground_truth"] > 1))[1])
    print(folder / "report.html")
