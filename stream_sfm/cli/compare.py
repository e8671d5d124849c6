"""`stream-sfm compare`: every method on the same observations, and the drift report."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import ExitCode
from . import arguments

if TYPE_CHECKING:
    from ..recording import StereoLog
    from ..report.records import Comparison

# The names of `comparison.COMPARED`, which the help lists without importing the estimators.
DEFAULT_METHODS = "cross-frame,cross-frame-wc,cross-frame-cc,ekf,ekf-cv,frame-to-frame"


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser = arguments.add_command(
        subparsers,
        "compare",
        run,
        summary="compare the drift of the cross-frame method and the EKF in an HTML report",
        description="Run several methods on the same observations: by default the cross-frame method (joint, "
        "per-point WC and per-point CC), the EKF and frame-to-frame estimation. Writes report.html (a single file), "
        "report.json, and one result folder per method, as `replay` does.",
        usage="LOG [options]",
    )
    arguments.add_log(parser)
    arguments.add_cameras(parser)
    frames = arguments.add_selection(parser)
    frames.add_argument(
        "--there-and-back",
        choices=("auto", "yes", "no"),
        default="auto",
        help="read the frames forwards, then backwards: yes, no, or auto (default: where the log has no ground truth)",
    )
    arguments.add_settings(parser, method=False)
    results = parser.add_argument_group("results")
    results.add_argument(
        "--methods",
        metavar="NAME,…",
        help=f"the methods, separated by commas (default: {DEFAULT_METHODS.replace(',', ', ')})",
    )
    results.add_argument("--out", metavar="DIR", help="result folder (default: runs/LOG-TIME)")
    arguments.add_general(parser, json="report.json", quiet=True)


def run(args: argparse.Namespace) -> int:
    """Compare, print a table, and return whether the whole log and all methods were processed."""
    from ..pipeline.replay import check_selection, new_run_folder, point_latest_to
    from ..recording import open_log

    config = arguments.read_settings(args)
    check_selection(args.start, args.end)
    log = open_log(args.log, args.left, args.right, args.calibration)
    folder = Path(args.out) if args.out else new_run_folder(args.log)
    comparison, content = _compare(log, folder, config, args)
    if not args.out:
        point_latest_to(folder)
    _print(comparison, content, folder, args)
    if comparison.interrupted:
        return ExitCode.INTERRUPTED
    if any(r.failure for r in comparison.runs):
        return ExitCode.DEFECT
    return ExitCode.DONE if comparison.complete else ExitCode.INPUT


def _compare(
    log: "StereoLog", folder: Path, config: Any, args: argparse.Namespace
) -> tuple["Comparison", dict[str, Any]]:
    from ..comparison.compare import Selection
    from ..comparison.files import compare_into
    from ..inspection import inspect_log
    from .progress import frame_progress

    names = (name.strip() for name in (args.methods or DEFAULT_METHODS).split(","))
    chosen = Selection(args.start, args.end, args.max_frames, args.stride)
    there_and_back = {"auto": None, "yes": True, "no": False}[args.there_and_back]
    total = arguments.frames_to_read(log.expected_frames, args)
    with frame_progress("compare", total, args.quiet) as on_frame:
        return compare_into(
            log,
            folder,
            config,
            tuple(dict.fromkeys(name for name in names if name)),
            None if chosen == Selection() else chosen,
            there_and_back=there_and_back,
            inspection=inspect_log(args.log, args.left, args.right, args.calibration),
            on_frame=on_frame,
        )


def _print(comparison: "Comparison", content: dict[str, Any], folder: Path, args: argparse.Namespace) -> None:
    from ..report.numbers import conclusion
    from .comparison_table import print_comparison
    from .printing import print_json, print_notes

    if args.json:
        print_json(content)
    elif not args.quiet:
        print_notes("warning", comparison.warnings)
        print_comparison(content)
        print(conclusion(content, bool(content["frames_with_ground_truth"] > 1))[1])
        print(folder / "report.html")
