"""`stream-sfm inspect`: what a log contains, and whether it can be replayed."""

import argparse
from typing import Any

from ..errors import ExitCode
from . import arguments


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser = arguments.add_command(
        subparsers,
        "inspect",
        run,
        summary="show what a log contains and check whether it can be replayed",
        description="Show the topics of a log, the stereo pair that would be used and why, frame rate, gaps and "
        "calibration, and check the calibration against the images. If a replay cannot work, the exit code is 3 and "
        "the output says what to change.",
        usage="LOG [options]",
    )
    arguments.add_log(parser)
    arguments.add_cameras(parser)
    arguments.add_general(parser, json="the description as one JSON object")


def run(args: argparse.Namespace) -> int:
    """Inspect and print."""
    from ..inspection import inspect_log
    from .inspection_tables import print_inspection
    from .printing import print_json

    found = inspect_log(args.log, args.left, args.right, args.calibration)
    if args.json:
        print_json(found)
    else:
        print_inspection(found)
    return ExitCode.INPUT if found["problems"] else ExitCode.DONE
