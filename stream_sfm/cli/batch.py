"""`stream-sfm batch`: many logs in parallel, one result folder per log, one table and one page."""

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from ..errors import ConfigError, ExitCode
from . import arguments

COMPARE = "compare"  # in front of the logs: methods are compared on them


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser = arguments.add_command(
        subparsers,
        "batch",
        run,
        summary="replay many logs in parallel, with one table and one HTML page for all",
        description="Replay many logs in parallel, each in its own process: one that fails, crashes or hangs does not "
        "affect the others. Writes one result folder per log, as `replay` does, batch.json and report.html (a single "
        "file). A second run processes only what is missing or has changed. `batch compare LOG...` compares the "
        "methods on every log instead, or on several starts of one: one table of ratios with intervals, in "
        "comparison.json and report.html.",
        usage="[compare] LOG... --out DIR [options]",
    )
    parser.add_argument(
        "logs", nargs="+", metavar="LOG", help="recordings of any kind, folders of them, or patterns"
    )
    results = parser.add_argument_group("results")
    results.add_argument(
        "--out", type=arguments.output, metavar="DIR", required=True, help="folder for the results of all logs"
    )
    arguments.add_workers(parser)
    results.add_argument(
        "--timeout",
        type=arguments.seconds,
        default=600.0,
        metavar="S",
        help="stop a log that delivers no frame for S seconds (default: 600), which includes the first reading of "
        "--calibrate; `batch compare` has no such limit",
    )
    compared = parser.add_argument_group("batch compare")
    compared.add_argument(
        "--starts",
        type=arguments.positive,
        default=1,
        metavar="N",
        help="run each log from N starts (default: 1); they are samples of their own where they share no frame, by "
        "--max-frames",
    )
    compared.add_argument(
        "--start-step", type=arguments.seconds, default=1.0, metavar="S", help="seconds between starts (default: 1)"
    )
    compared.add_argument("--methods", metavar="NAME,…", help="the methods, separated by commas")
    arguments.add_calibrate(arguments.add_cameras(parser))
    arguments.add_truth_file(parser, "FILE|DIR")
    arguments.add_selection(parser)
    arguments.add_settings(parser)
    arguments.add_general(parser, json="batch.json (`batch compare`: comparison.json)", quiet=True)


def run(args: argparse.Namespace) -> int:
    """Replay all logs, print a table, and return whether all of them were completed."""
    if args.logs[0] == COMPARE and len(args.logs) > 1 and not os.path.exists(COMPARE):
        return _compare(args)
    from ..batch.logs import find_logs
    from ..batch.replay_batch import replay_batch
    from .progress import counter

    config = arguments.read_settings(args)
    selection = arguments.read_selection(args)
    truth = arguments.read_ground_truth(args)
    with counter("batch", "logs", len(find_logs(args.logs)), args.quiet) as advance:
        content = replay_batch(
            args.logs,
            args.out,
            config,
            selection,
            left=args.left,
            right=args.right,
            calibration=args.calibration,
            calibrate=args.calibrate,
            ground_truth=truth,
            workers=args.workers,
            scheduler=args.scheduler,
            timeout_s=args.timeout,
            on_done=lambda result: advance(1, f"{result.name}: {result.status}"),
        )
    _print(content, Path(args.out), args)
    if content["interrupted"]:
        return ExitCode.INTERRUPTED
    return ExitCode.DONE if content["complete"] else ExitCode.INPUT


def _compare(args: argparse.Namespace) -> int:
    """Compare the methods on all logs, print the table, and return whether all of them were compared."""
    from ..batch.logs import find_logs
    from ..run.compare import COMPARED
    from ..run.many import compare_many
    from ..wording import printable
    from .batch_table import print_many
    from .printing import cleaned, print_json
    from .progress import counter

    if args.ground_truth is not None:
        raise ConfigError("`batch compare` takes the ground truth that each log has: leave --ground-truth out")
    if args.method is not None:
        raise ConfigError("`batch compare` runs several methods: name them with --methods, and leave --method out")
    config, selection = arguments.read_settings(args), arguments.read_selection(args)
    logs = list(find_logs(args.logs[1:]))
    names = (name.strip() for name in args.methods.split(",")) if args.methods else COMPARED
    with counter("compare", "runs", len(logs) * args.starts, args.quiet) as advance:
        content = compare_many(
            logs,
            args.out,
            config,
            selection,
            left=args.left,
            right=args.right,
            calibration=args.calibration,
            calibrate=args.calibrate,
            methods=tuple(dict.fromkeys(names)),
            starts=args.starts,
            start_step_s=args.start_step,
            workers=int(args.workers),
            scheduler=args.scheduler,
            on_done=lambda name: advance(1, name),
        )
    if args.json:
        print_json(content)
    elif not args.quiet:
        print_many(content)
        print(content["conclusion"])
        print(printable(str(Path(args.out) / "report.html")))
    failed = [s for s in cleaned(content["samples"]) if s["failure"]]
    for s in failed:
        print(f"stream-sfm: {s['log']} from {s['start_s']:g} s: {s['failure']}", file=sys.stderr)
    if content["interrupted"]:
        return ExitCode.INTERRUPTED
    return ExitCode.INPUT if failed else ExitCode.DONE


def _print(content: dict[str, Any], out: Path, args: argparse.Namespace) -> None:
    from ..report.batch_page import conclusion
    from ..wording import printable
    from .batch_table import print_batch
    from .printing import cleaned, print_json, print_notes

    if not args.quiet:
        print_notes("skipped", content["skipped"])
    if args.json:
        print_json(content)
    elif not args.quiet:
        print_batch(content)
        print(conclusion(content))
        print(printable(str(out / "report.html")))
    for log in cleaned(content["logs"]):
        if log["status"] != "done":
            print(f"stream-sfm: {log['name']}: {log['status']}: {log['reason']}", file=sys.stderr)
