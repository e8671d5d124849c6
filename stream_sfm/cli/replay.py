"""`stream-sfm replay`: a log in, a folder of results out."""

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import ExitCode
from . import arguments

if TYPE_CHECKING:
    from ..config import Config
    from ..recording import StereoLog
    from ..run.replay import ReplayResult
    from ..types import Selection, Sink


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser = arguments.add_command(
        subparsers,
        "replay",
        run,
        summary="estimate the camera's motion and the local structure in every frame of a log",
        description="Estimate the pose of the left camera and the 3-D structure in front of it, with covariances, for "
        "every frame of a stereo log. Writes estimates.mcap (with metadata.yaml a ROS 2 bag), trajectory.tum, "
        "trajectory.kitti, trajectory.csv, summary.json, report.html and config.toml.",
        usage="LOG [options]",
    )
    arguments.add_log(parser)
    cameras = arguments.add_cameras(parser)
    cameras.add_argument(
        "--mono",
        action="store_true",
        help="use the left camera only; lengths are in units of the first baseline instead of metres",
    )
    frames = arguments.add_selection(parser)
    frames.add_argument(
        "--there-and-back",
        action="store_true",
        help="read the frames forwards, then backwards: shows the drift of a log without ground truth",
    )
    arguments.add_calibrate(cameras)
    arguments.add_ground_truth(parser)
    arguments.add_self_test(parser)
    arguments.add_settings(parser)
    results = parser.add_argument_group("results")
    results.add_argument(
        "--out", type=arguments.output, metavar="DIR", help="result folder (default: runs/LOG-TIME)"
    )
    results.add_argument("--rrd", metavar="FILE", help="write a recording for the Rerun viewer (extra [view])")
    results.add_argument("--view", action="store_true", help="show the run in the Rerun viewer as it proceeds")
    results.add_argument("--strict", action="store_true", help="exit with code 3 if there was any warning")
    arguments.add_general(parser, json="summary.json", quiet=True, verbose=True)


def run(args: argparse.Namespace) -> int:
    """Replay, print, and return whether the log was read to its end."""
    from ..recording import open_log
    from ..results.folder import changed_results, new_run_folder, point_latest_to
    from ..run.replay import ReplayInterrupted

    config = arguments.read_settings(args, ["mono=true"] if args.mono else [])
    selection = arguments.read_selection(args)
    folder = Path(args.out) if args.out else new_run_folder(args.log)
    arguments.protect_inputs(args, [args.rrd, *changed_results(folder, config)])
    truth = arguments.read_ground_truth(args)
    log = open_log(args.log, args.left, args.right, args.calibration, mono=config.mono, ground_truth=truth)
    interrupted = False
    try:
        result = _replay(log, folder, config, selection, args)
    except ReplayInterrupted as stop:
        result, interrupted = stop.result, True
    finally:
        if not args.out and os.path.exists(folder):
            point_latest_to(folder)
    _print(result, args)
    if interrupted:
        return ExitCode.INTERRUPTED
    summary = result.summary
    if result.problems or not summary["complete"] or (args.strict and summary["warnings"]):
        return ExitCode.INPUT
    return ExitCode.DONE


def _replay(
    log: "StereoLog", folder: Path, config: "Config", selection: "Selection", args: argparse.Namespace
) -> "ReplayResult":
    from ..run.replay import replay
    from .progress import frame_progress

    viewers = _viewers(log, config.mono, args)
    total = selection.count(log.expected_frames)
    with frame_progress("replay", total, args.quiet, args.verbose) as progress:
        sinks = [*viewers, progress]
        return replay(
            log,
            folder,
            config,
            selection,
            there_and_back=args.there_and_back,
            ignore_ground_truth=args.ignore_ground_truth,
            calibrate=args.calibrate,
            self_test=args.self_test,
            std_truth=args.ground_truth_std,
            sinks=sinks,
        )


def _viewers(log: "StereoLog", mono: bool, args: argparse.Namespace) -> list["Sink"]:
    """The viewer that was asked for, if any."""
    if not args.rrd and not args.view:
        return []
    from ..viewer import open_viewer

    truth = None if mono else log.ground_truth()
    return [open_viewer(log.rig, args.rrd, args.view, truth, log.path.stem)]


def _print(result: "ReplayResult", args: argparse.Namespace) -> None:
    from .error_lines import print_error
    from .printing import print_json, print_notes
    from .replay_table import print_summary

    if not args.quiet:
        print_notes("warning", result.summary["warnings"])
    if args.json:
        print_json({**result.summary, "out": str(result.out_dir)})
    elif not args.quiet:
        print_summary(result.summary, result.out_dir, stages=args.verbose)
    for problem in result.problems:
        print_error(problem)
