"""`stream-sfm batch`: many logs in parallel, one result folder per log, one table and one page."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import ExitCode
from . import arguments

if TYPE_CHECKING:
    from ..config import Config


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser = arguments.add_command(
        subparsers,
        "batch",
        run,
        summary="replay many logs in parallel, with one table and one HTML page for all",
        description="Replay many logs in parallel, each in its own process: one that fails, crashes or hangs does not "
        "affect the others. Writes one result folder per log, as `replay` does, batch.json and report.html (a single "
        "file). A second run processes only what is missing or has changed.",
        usage="LOG... --out DIR [options]",
    )
    parser.add_argument("logs", nargs="+", metavar="LOG", help="stereo logs (MCAP), folders of logs, or patterns")
    results = parser.add_argument_group("results")
    results.add_argument("--out", metavar="DIR", required=True, help="folder for the results of all logs")
    arguments.add_workers(parser)
    results.add_argument(
        "--timeout",
        type=arguments.seconds,
        default=600.0,
        metavar="S",
        help="stop a log that delivers no frame for S seconds (default: 600)",
    )
    arguments.add_cameras(parser)
    arguments.add_selection(parser)
    arguments.add_settings(parser)
    arguments.add_general(parser, json="batch.json", quiet=True)


def run(args: argparse.Namespace) -> int:
    """Replay all logs, print a table, and return whether all of them were completed."""
    config = arguments.read_settings(args)
    config.needs_scale("batch, which compares metres,")
    arguments.read_selection(args)  # an impossible one is refused here, not once per log
    content = _run(config, args)
    _print(content, Path(args.out), args)
    if content["interrupted"]:
        return ExitCode.INTERRUPTED
    return ExitCode.DONE if content["complete"] else ExitCode.INPUT


def _run(config: "Config", args: argparse.Namespace) -> dict[str, Any]:
    from concurrent.futures import ThreadPoolExecutor

    from ..batch.collect import run_batch
    from ..batch.logs import find_logs
    from ..camera.rig import StereoRig
    from ..executors import cluster
    from .progress import counter

    calibration = Path(args.calibration).resolve() if args.calibration else None
    if calibration is not None:
        StereoRig.from_calibration(calibration)  # a mistake in it is reported once, before any log is started
    logs = find_logs(args.logs)
    with (
        # The threads only wait for the processes that replay.
        cluster(args.scheduler) if args.scheduler else ThreadPoolExecutor(args.workers) as executor,
        counter("batch", "logs", len(logs), args.quiet) as advance,
    ):
        return run_batch(
            logs,
            Path(args.out),
            config,
            executor,
            options=arguments.selection_options(args),
            calibration=calibration,
            timeout_s=args.timeout,
            on_done=lambda result: advance(1, f"{result.name}: {result.status}"),
        )


def _print(content: dict[str, Any], out: Path, args: argparse.Namespace) -> None:
    from ..report.batch_page import conclusion
    from .batch_table import print_batch
    from .printing import print_json

    if args.json:
        print_json(content)
    elif not args.quiet:
        print_batch(content)
        print(conclusion(content))
        print(out / "report.html")
    for log in content["logs"]:
        if log["status"] != "done":
            print(f"stream-sfm: {log['name']}: {log['status']}: {log['reason']}", file=sys.stderr)
