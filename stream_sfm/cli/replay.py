"""`stream-sfm replay`: a log in, a folder of results out."""

import argparse
from pathlib import Path
from typing import Any

from ..errors import ExitCode
from . import arguments


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "replay",
        help="estimate pose and local structure of every frame of a log",
        description="Estimate the pose of the left camera and the structure in front of it, with covariances, for "
        "every frame of a recorded stereo log. Writes estimates.mcap, trajectory.tum, trajectory.kitti, "
        "summary.json and config.toml.",
    )
    arguments.add_log(parser)
    parser.add_argument(
        "--mono",
        action="store_true",
        help="use the left camera alone (the log may have no other): lengths are then in units of the first baseline",
    )
    parser.add_argument("--out", metavar="DIR", help="folder of the results (default runs/<log>-<time>)")
    arguments.add_method(parser)
    arguments.add_selection(parser)
    parser.add_argument(
        "--there-and-back",
        action="store_true",
        help="then the same frames backwards: the drift of a log without ground truth",
    )
    arguments.add_configuration(parser)
    parser.add_argument("--rrd", metavar="FILE", help="write a recording for the Rerun viewer")
    parser.add_argument("--view", action="store_true", help="show the run in the Rerun viewer")
    parser.add_argument("--json", action="store_true", help="print the summary as one JSON object, nothing else")
    parser.add_argument("-q", "--quiet", action="store_true", help="print errors only")
    parser.add_argument("-v", "--verbose", action="store_true", help="tell each change of status, and timings")
    parser.add_argument(
        "--strict", action="store_true", help="exit with 3 on any warning, also where all frames were estimated"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Replay, print, and say by the exit code whether the log was read whole."""
    from ..pipeline.replay import ReplayInterrupted, check_selection, new_run_folder, point_latest_to, replay
    from ..recording import open_log
    from . import output

    config = arguments.read_settings(args, ["mono=true"] if args.mono else [])
    check_selection(args.start, args.end)
    log = open_log(args.log, args.left, args.right, args.calibration, mono=config.mono)
    folder = Path(args.out) if args.out else new_run_folder(args.log)
    interrupted = False
    viewer = None
    if args.rrd or args.view:
        from ..viewer import open_viewer

        truth = None if config.mono else log.ground_truth()
        viewer = open_viewer(log.rig, args.rrd, args.view, truth, log.path.stem)
    try:
        with output.progress(output.frames_to_come(log.expected_frames, args), args.quiet) as tell:
            if args.verbose:
                tell.status_changes = True
            result = replay(
                log,
                folder,
                config,
                start_s=args.start,
                end_s=args.end,
                max_frames=args.max_frames,
                stride=args.stride,
                there_and_back=args.there_and_back,
                on_frame=tell,
                viewer=viewer,
            )
    except ReplayInterrupted as stop:
        result, interrupted = stop.result, True
    finally:
        if not args.out and folder.exists():
            point_latest_to(folder)
    output.print_replay(result, args)
    if interrupted:
        return ExitCode.INTERRUPTED
    summary = result.summary
    if not summary["complete"] or (args.strict and summary["warnings"]):
        return ExitCode.INPUT
    return ExitCode.DONE
