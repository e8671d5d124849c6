"""`stream-sfm calibration`: calibrations of other tools to the TOML of this package."""

import argparse
import re
from pathlib import Path
from typing import Any

from ..errors import ConfigError, ExitCode, RigError
from . import arguments


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser = arguments.add_command(
        subparsers,
        "calibration",
        None,
        summary="convert the calibration of another tool to TOML",
        description="Read calibrations of Kalibr, ROS, EuRoC, KITTI and OpenCV. Wherever a calibration is given to "
        "another command, it need not be converted.",
        usage="convert IN --out OUT.toml",
    )
    kinds = parser.add_subparsers(title="actions", metavar="ACTION", dest="kind", required=True)
    convert = arguments.add_command(
        kinds,
        "convert",
        _convert,
        summary="write a calibration as TOML",
        description="Recognise a calibration by its content and write it as TOML. IN is a file, the files of the left "
        "and of the right camera, or the folder they are in.",
        usage="IN [IN] --out OUT.toml [options]",
        parent="calibration",
    )
    convert.add_argument("files", metavar="IN", nargs="+", help="file or folder; the left camera's file first")
    group = convert.add_argument_group("result")
    group.add_argument("--out", type=arguments.output, metavar="OUT.toml", required=True, help="the file to write")
    group.add_argument(
        "--size", metavar="W×H", help="size of the images in pixels, for formats that do not contain it"
    )
    arguments.add_general(convert, json="the rig, as one JSON object,")
    arguments.add_general(parser)


def _convert(args: argparse.Namespace) -> int:
    from ..camera.rectification import check_rectifiable
    from ..camera.rig import StereoRig, baseline_question
    from ..files import write_whole
    from ..inspection.overview import describe_rig
    from ..outputs import refuse_overwriting
    from .printing import print_json, print_notes

    refuse_overwriting([Path(args.out)], [Path(file) for file in args.files])
    where = args.files[0] if len(args.files) == 1 else args.files
    rig = StereoRig.from_calibration(where, _size(args.size))
    write_whole(args.out, rig.to_toml().encode())
    questions = list(filter(None, [baseline_question(rig)]))
    try:
        check_rectifiable(rig)
    except RigError as error:  # the file may be converted in order to be corrected
        questions.append(str(error))
    print_notes("warning", questions)
    if args.json:
        print_json({"out": args.out, **describe_rig(rig)})
    else:
        left = rig.left
        print(f"written to {args.out}: {left.width}×{left.height} pixels, baseline {rig.baseline_m:.4g} m")
    return ExitCode.DONE


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    if (found := re.fullmatch(r"(\d{1,6})\s*[x×,]\s*(\d{1,6})", text)) is None:
        raise ConfigError(f"the size {text!r} is not a width and a height: write it as 1241x376")
    return int(found[1]), int(found[2])
