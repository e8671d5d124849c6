"""`stream-sfm inspect`: what is in a log, and whether it can be replayed."""

import argparse
from typing import Any

from ..errors import ExitCode
from . import arguments


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "inspect",
        help="say what is in a log and whether it can be replayed",
        description="Topics, the stereo pair that would be used and why, rate, gaps, calibration and a check of "
        "it. Exit code 3 where a replay could not work, with what to change.",
    )
    arguments.add_log(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Inspect and print."""
    from ..inspection import inspect_log
    from . import output

    found = inspect_log(args.log, args.left, args.right, args.calibration)
    if args.json:
        output.print_json(found)
    else:
        output.print_inspection(found)
    return ExitCode.INPUT if found["problems"] else ExitCode.DONE
