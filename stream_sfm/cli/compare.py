"""`stream-sfm compare`: every method on the same observations, and the drift report."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import ExitCode
from . import arguments

if TYPE_CHECKING:
    from ..config import Config
    from ..recording import StereoLog
    from ..run.compare import ComparisonResult
    from ..types import Selection

# The names of `comparison.COMPARED`, which the help lists without importing the estimators.
DEFAULT_METHODS = "cross-frame,cross-frame-wc,cross-frame-cc,ekf,iterated-ekf,ekf-cv,frame-to-frame"


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser = arguments.add_command(
        subparsers,
        "compare",
        run,
        summary="compare the drift of the cross-frame method and the EKF in an HTML report",
        description="Run several methods on the same observations: by default the cross-frame method (joint, "
        "per-point WC and per-point CC), three EKFs (plain; iterated and camera-centred; linearised at a constant "
        "velocity) and frame-to-frame estimation. Writes report.html (a single file), report.json, and one result "
        "folder per method, as `replay` does.",
        usage="LOG [options]",
    )
    arguments.add_log(parser)
    arguments.add_calibrate(arguments.add_cameras(parser))
    arguments.add_self_test(parser)
    frames = arguments.add_selection(parser)
    frames.add_argument(
        "--there-and-back",
        choices=("auto", "yes", "no"),
        default="auto",
        help="read the frames forwards, then backwards: yes, no, or auto (default: where the log has no ground truth)",
    )
    arguments.add_ground_truth(parser)
    arguments.add_settings(parser, method=False)
    results = parser.add_argument_group("results")
    results.add_argument(
        "--methods",
        metavar="NAME,…",
        help=f"the methods, separated by commas (default: {DEFAULT_METHODS.replace(',', ', ')})",
    )
    results.add_argument(
        "--out", type=arguments.output, metavar="DIR", help="result folder (default: runs/LOG-TIME)"
    )
    arguments.add_general(parser, json="report.json", quiet=True)


def run(args: argparse.Namespace) -> int:
    """Compare, print a table, and return whether the whole log and all methods were processed."""
    from ..recording import open_log
    from ..results.folder import new_run_folder, point_latest_to

    config = arguments.read_settings(args)
    selection = arguments.read_selection(args)
    truth = arguments.read_ground_truth(args)
    log = open_log(args.log, args.left, args.right, args.calibration, ground_truth=truth)
    folder = Path(args.out) if args.out else new_run_folder(args.log)
    result = _compare(log, folder, config, selection, args)
    if not args.out:
        point_latest_to(folder)
    _print(result, folder, args)
    comparison = result.comparison
    if comparison.interrupted:
        return ExitCode.INTERRUPTED
    if any(r.failure for r in comparison.runs):
        return ExitCode.DEFECT
    return ExitCode.INPUT if comparison.inspection["problems"] or not comparison.complete else ExitCode.DONE


def _compare(
    log: "StereoLog", folder: Path, config: "Config", selection: "Selection", args: argparse.Namespace
) -> "ComparisonResult":
    from ..inspection import inspect_log
    from ..run.compare import compare, outputs
    from .printing import print_notes
    from .progress import frame_progress

    names = (name.strip() for name in (args.methods or DEFAULT_METHODS).split(","))
    methods = tuple(dict.fromkeys(name for name in names if name))
    arguments.protect_inputs(args, outputs(folder, methods))
    inspection = inspect_log(args.log, args.left, args.right, args.calibration)
    print_notes("problem", inspection["problems"])
    with frame_progress("compare", selection.count(log.expected_frames), args.quiet) as progress:
        return compare(
            log,
            folder,
            config,
            selection,
            methods=methods,
            there_and_back={"auto": None, "yes": True, "no": False}[args.there_and_back],
            ignore_ground_truth=args.ignore_ground_truth,
            inspection=inspection,
            calibrate=args.calibrate,
            self_test=args.self_test,
            std_truth=args.ground_truth_std,
            sinks=[progress],
        )


def _print(result: "ComparisonResult", folder: Path, args: argparse.Namespace) -> None:
    from ..wording import printable
    from .comparison_table import print_comparison
    from .error_lines import print_error
    from .printing import print_json, print_notes

    content = result.report
    if args.json:
        print_json(content)
    elif not args.quiet:
        print_notes("warning", result.comparison.warnings)
        print_comparison(content)
        print(content["conclusion"])
        print(printable(str(folder / "report.html")))
    for problem in result.comparison.inspection["problems"]:
        print_error(problem)
