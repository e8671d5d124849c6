"""Arguments that several commands share, and their checks."""

import argparse
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..config import Config
    from ..recording.truth_file import GroundTruthFile
    from ..types import Selection

# The names of `estimators.METHODS`, which a parser must know without importing the estimators.
METHODS = (
    "cross-frame",
    "cross-frame-wc",
    "cross-frame-cc",
    "cross-frame-cc-literal",
    "ekf",
    "iterated-ekf",
    "ekf-cv",
    "frame-to-frame",
    "depth-filter",
)


class OneOrTwo(argparse.Action):
    """Takes an option once, or twice for left and right: text, or a list of two texts."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        """Add one file."""
        given = getattr(namespace, self.dest, None)
        if isinstance(given, list):
            raise argparse.ArgumentError(self, "give one file, or two: left and right")
        setattr(namespace, self.dest, values if given is None else [given, values])


def add_command(
    subparsers: Any,
    name: str,
    run: Callable[[argparse.Namespace], int] | None,
    *,
    summary: str,
    description: str,
    usage: str,
    parent: str = "",
) -> argparse.ArgumentParser:
    """A parser for one command, without any arguments; `summary` appears in the list of commands.

    `run` is None for a command that only has commands of its own; those name it as their `parent`.
    """
    prog = " ".join(filter(None, ("stream-sfm", parent, name)))
    parser: argparse.ArgumentParser = subparsers.add_parser(
        name, help=summary, description=description, prog=prog, usage=f"{prog} {usage}"
    )
    if run is not None:
        parser.set_defaults(run=run)
    return parser


def add_general(
    parser: argparse.ArgumentParser, *, json: str = "", quiet: bool = False, verbose: bool = False
) -> None:
    """The options that mean the same in every command; `json` is what a command prints with --json."""
    group = parser.add_argument_group("general")
    if json:
        group.add_argument("--json", action="store_true", help=f"print {json} and nothing else")
    if quiet:
        group.add_argument("-q", "--quiet", action="store_true", help="print errors only")
    if verbose:
        group.add_argument(
            "-v", "--verbose", action="store_true", help="report every change of status, and the time per stage"
        )
    add_debug(group, default=argparse.SUPPRESS)
    group.add_argument("-h", "--help", action="help", help="show this help and exit")


def add_debug(group: Any, default: Any = False) -> None:
    """The option --debug, which is accepted before and after the command."""
    group.add_argument(
        "--debug", action="store_true", default=default, help="print the traceback of an error as well"
    )


def add_log(parser: argparse.ArgumentParser) -> None:
    """The log to read."""
    parser.add_argument(
        "log", metavar="LOG", help="the recording: MCAP, a ROS bag, a KITTI or EuRoC folder, image folders"
    )


def add_cameras(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """How the cameras of a log are found."""
    group = parser.add_argument_group("cameras")
    group.add_argument("--left", metavar="TOPIC", help="topic of the left images (default: found automatically)")
    group.add_argument("--right", metavar="TOPIC", help="topic of the right images (default: found automatically)")
    group.add_argument(
        "--calibration",
        action=OneOrTwo,
        metavar="FILE",
        help="use this calibration instead of the log's own: a file or folder, ours (TOML) or of other tools; or the "
        "files of left and right, in this order",
    )
    return group


def add_calibrate(cameras: argparse._ArgumentGroup) -> None:
    """The option --calibrate, beside those of the cameras."""
    cameras.add_argument(
        "--calibrate",
        action="store_true",
        help="read the frames twice: first learn how the calibration errs, then estimate with it corrected",
    )


def add_self_test(parser: argparse.ArgumentParser) -> None:
    """The option --self-test."""
    group = parser.add_argument_group("covariances")
    group.add_argument(
        "--self-test",
        action="store_true",
        help="check them without any truth: disjoint halves of the tracks, and of the image, must agree within them",
    )


def add_truth_file(parser: argparse.ArgumentParser, metavar: str) -> argparse._ArgumentGroup:
    """Where ground truth is, if not in the log; with DIR in `metavar` a folder of such files will do."""
    group = parser.add_argument_group("ground truth")
    of_logs = "; or of a folder, the file that is named after the log" if "DIR" in metavar else ""
    group.add_argument(
        "--ground-truth",
        metavar=metavar,
        help=f"use the poses in this file instead of the log's own: TUM, EuRoC's CSV, or KITTI with stamps{of_logs}",
    )
    group.add_argument(
        "--ground-truth-frame",
        metavar="FRAME",
        help="whose poses they are: a frame of the log's transforms, or a sensor.yaml (default: the left camera)",
    )
    group.add_argument(
        "--ground-truth-offset", metavar="S", type=float, default=0.0, help="add S seconds to their stamps"
    )
    return group


def add_ground_truth(parser: argparse.ArgumentParser) -> None:
    """Ground truth that is not in the log, and what is known of it."""
    group = add_truth_file(parser, "FILE")
    group.add_argument(
        "--ignore-ground-truth",
        metavar="A:B,…",
        type=frame_ranges,
        default=[],
        help="do not compare frames A to B-1 with the ground truth, because it is wrong there",
    )
    group.add_argument(
        "--ground-truth-std",
        metavar="M,RAD",
        type=_std_truth,
        default=(0.0, 0.0),
        help="σ of the ground truth itself: of positions in metres, of rotations in radians",
    )


def read_ground_truth(args: argparse.Namespace) -> "GroundTruthFile | None":
    """The file that `add_ground_truth` chose, if any."""
    from ..recording.truth_file import GroundTruthFile

    if args.ground_truth is None:
        return None
    return GroundTruthFile(args.ground_truth, args.ground_truth_frame, args.ground_truth_offset)


def add_selection(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Which frames of a log are read."""
    group = parser.add_argument_group("frames")
    group.add_argument("--start", type=seconds, metavar="S", help="begin S seconds after the first frame")
    group.add_argument("--end", type=seconds, metavar="S", help="end S seconds after the first frame")
    group.add_argument("--max-frames", type=positive, metavar="N", help="read at most N frames")
    group.add_argument("--stride", type=positive, default=1, metavar="N", help="read every N-th frame")
    return group


def read_selection(args: argparse.Namespace) -> "Selection":
    """The frames that `add_selection` chose. Raises ConfigError where no frame can be among them."""
    from ..types import Selection

    return Selection(args.start, args.end, args.max_frames, args.stride)


def add_settings(parser: argparse.ArgumentParser, *, method: bool = True) -> None:
    """The estimator (`method`) and all other settings."""
    group = parser.add_argument_group("settings")
    if method:
        group.add_argument(
            "--method",
            choices=METHODS,
            metavar="NAME",
            help=f"the estimator: {METHODS[0]} (default), {', '.join(METHODS[1:])}",
        )
    group.add_argument(
        "--estimate-every",
        type=positive,
        metavar="K",
        help="track every frame, estimate every K-th: less work, and more motion between estimates (default: 1)",
    )
    group.add_argument(
        "--config", metavar="FILE", help="read settings from this file (`stream-sfm config` prints them all)"
    )
    group.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one setting, for example window.frames=12; may be repeated",
    )


def read_settings(args: argparse.Namespace, further: Sequence[str] = ()) -> "Config":
    """The configuration of --config, --set, --method and `further` settings. Raises ConfigError."""
    from ..config import read_config

    method = [f'method="{args.method}"'] if getattr(args, "method", None) else []
    every = [f"estimate_every={args.estimate_every}"] if getattr(args, "estimate_every", None) else []
    return read_config(args.config, [*args.set, *method, *every, *further])


def protect_inputs(args: argparse.Namespace, outputs: Sequence[str | Path | None]) -> None:
    """Raise an OutputError where one of the outputs is an input of the command (None: no output)."""
    from ..outputs import refuse_overwriting

    named = [getattr(args, name, None) for name in ("log", "ground_truth", "config")]
    calibration = getattr(args, "calibration", None)
    named += calibration if isinstance(calibration, list) else [calibration]
    refuse_overwriting([Path(path) for path in outputs if path], [Path(path) for path in named if path])


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Where work runs in parallel."""
    where = parser.add_argument_group("parallel work").add_mutually_exclusive_group()
    where.add_argument(
        "--workers",
        type=positive,
        default=str(os.cpu_count() or 1),  # text, so that argparse can tell the default from a value that equals it
        metavar="N",
        help="number of processes on this machine (default: one per CPU core)",
    )
    where.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="use a Dask cluster instead, for example tcp://127.0.0.1:8786 (needs stream-sfm[cluster])",
    )


def frame_ranges(text: str) -> list[tuple[int, int]]:
    """Ranges of frames, such as 0:15,40:44."""
    ranges = []
    for part in text.split(","):
        first, _, end = part.partition(":")
        if not (first.strip().isdecimal() and end.strip().isdecimal() and int(first) < int(end)):
            raise argparse.ArgumentTypeError(
                f"{part!r} is not a range of frames: give it as 0:15 for frames 0 to 14"
            )
        ranges.append((int(first), int(end)))
    return ranges


def positive(text: str) -> int:
    """A whole number of at least 1."""
    return _whole(text, 1)


def not_negative(text: str) -> int:
    """A whole number of at least 0."""
    return _whole(text, 0)


def _whole(text: str, least: int) -> int:
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if value < least:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least {least}")
    return value


def output(text: str) -> str:
    """The path of something to write, which an empty variable of a script is not."""
    if not text.strip():
        raise argparse.ArgumentTypeError("the name is empty")
    return text


def seconds(text: str) -> float:
    """A finite number of at least 0."""
    value = _number(text)
    if not value >= 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds (0 or more)")
    return value


def _std_truth(text: str) -> tuple[float, float]:
    """Two finite numbers of at least 0."""
    values = [_number(part) for part in text.split(",")]
    if len(values) != 2 or not all(value >= 0 for value in values):
        raise argparse.ArgumentTypeError(f"{text!r} is not a σ in metres and one in radians, such as 0.001,0.0005")
    return values[0], values[1]


def degrees(text: str) -> float:
    """An angle of at most a full turn."""
    value = _number(text)
    if not abs(value) <= 360:
        raise argparse.ArgumentTypeError(f"{text!r} is not an angle in degrees (-360 to 360)")
    return value


def _number(text: str) -> float:
    """A finite number, NaN for anything else."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
