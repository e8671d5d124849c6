"""`stream-sfm calibrate`: logs in, a refined calibration of their rig out."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import ExitCode
from . import arguments

if TYPE_CHECKING:
    from ..run.refine import RefinedRig


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser = arguments.add_command(
        subparsers,
        "calibrate",
        run,
        summary="refine the calibration of a rig from its recordings",
        description="Estimate from one log or several of the same cameras how their calibration errs, and write the "
        "calibration with these errors, to be given to other commands with --calibration. Errors of the baseline "
        "cannot be seen: they scale everything alike.",
        usage="LOG... --out REFINED.toml [options]",
    )
    parser.add_argument("logs", metavar="LOG", nargs="+", help="recordings of the same cameras")
    arguments.add_selection(parser)
    cameras = parser.add_argument_group("cameras")
    cameras.add_argument(
        "--calibration",
        action=arguments.OneOrTwo,
        metavar="FILE",
        help="refine this calibration instead of the one in the logs",
    )
    arguments.add_settings(parser, method=False)
    results = parser.add_argument_group("result")
    results.add_argument(
        "--out", type=arguments.output, metavar="REFINED.toml", required=True, help="the file to write"
    )
    arguments.add_general(parser, json="what was found, as one JSON object,")


def run(args: argparse.Namespace) -> int:
    """Calibrate, write the file and print what was found."""
    from ..files import write_whole
    from ..outputs import refuse_overwriting
    from ..run.refine import calibrate
    from .printing import print_json

    inputs = [
        *args.logs,
        *(args.calibration if isinstance(args.calibration, list) else filter(None, [args.calibration])),
    ]
    refuse_overwriting([Path(args.out)], [Path(path) for path in inputs])
    config, selection = arguments.read_settings(args), arguments.read_selection(args)
    refined = calibrate(args.logs, config, selection, calibration=args.calibration)
    write_whole(args.out, refined.rig.to_toml().encode())
    found = _found(refined, args)
    if args.json:
        print_json(found)
    else:
        for line in found["logs"]:
            print(f"{line['log']}: {line['text']}")
        print(f"written to {args.out}: give it to other commands with --calibration {args.out}")
    return ExitCode.DONE


def _found(refined: "RefinedRig", args: argparse.Namespace) -> dict[str, Any]:
    from ..camera.rectification import Rectifier
    from ..report.calibration_field import describe

    projection = Rectifier(refined.rig).projection
    logs = []
    for log, estimate in zip(args.logs, refined.estimates, strict=True):
        told: dict[str, Any] = {"text": "told nothing: no frame was tracked"}
        if estimate is not None:
            told = describe(estimate, projection.f_px * projection.baseline_m)
        logs.append({"log": str(log), **told})
    refinement = refined.rig.refinement
    numbers: dict[str, Any] = {}
    if refinement is not None:
        numbers = {"error_px": refinement.error_px.tolist(), "std_px": refinement.std_px.tolist()}
    return {"out": args.out, **numbers, "logs": logs}
