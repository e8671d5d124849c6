"""Arguments that several commands share, and their checks."""

import argparse
import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..config import Config

_SELECTION = {"left": None, "right": None, "start": None, "end": None, "max_frames": None, "stride": 1}


def add_log(parser: argparse.ArgumentParser) -> None:
    """LOG and how its cameras are found."""
    parser.add_argument("log", metavar="LOG", help="a stereo log (MCAP)")
    add_cameras(parser)


def add_cameras(parser: argparse.ArgumentParser) -> None:
    """How the cameras of a log are found."""
    parser.add_argument("--left", metavar="TOPIC", help="topic of the left images, if it is not found by itself")
    parser.add_argument("--right", metavar="TOPIC", help="topic of the right images")
    parser.add_argument("--calibration", metavar="FILE", help="calibration (TOML) instead of the log's own")


def add_selection(parser: argparse.ArgumentParser) -> None:
    """Which frames."""
    parser.add_argument("--start", type=seconds, metavar="S", help="seconds from the first frame")
    parser.add_argument("--end", type=seconds, metavar="S", help="seconds from the first frame")
    parser.add_argument("--max-frames", type=positive, metavar="N", help="at most so many frames")
    parser.add_argument("--stride", type=positive, default=1, metavar="N", help="every N-th frame")


def add_method(parser: argparse.ArgumentParser) -> None:
    """Which estimator."""
    parser.add_argument("--method", metavar="NAME", help="cross-frame (default), ekf, frame-to-frame")


def add_configuration(parser: argparse.ArgumentParser) -> None:
    """Settings."""
    parser.add_argument("--config", metavar="FILE", help="settings (TOML); `stream-sfm config` prints all")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="one setting, as in window.frames=12"
    )


def read_settings(args: argparse.Namespace, further: Sequence[str] = ()) -> "Config":
    """The configuration of --config, --set, --method and `further` settings. Raises ConfigError."""
    from ..config import read_config

    method = [f'method="{args.method}"'] if args.method else []
    return read_config(args.config, [*args.set, *method, *further])


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Where work runs in parallel."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers",
        type=positive,
        default=str(os.cpu_count() or 1),  # a text: argparse takes a value that is the default for not given
        metavar="N",
        help="processes of this machine (default: one a core)",
    )
    where.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="a Dask cluster instead, as in tcp://127.0.0.1:8786 (extra `cluster`)",
    )


def selection_options(args: argparse.Namespace) -> list[str]:
    """The topics and frames that were chosen, as options of `replay`."""
    chosen = {name: getattr(args, name) for name in _SELECTION}
    return [f"--{name.replace('_', '-')}={value}" for name, value in chosen.items() if value != _SELECTION[name]]


def positive(text: str) -> int:
    """A whole number of at least 1."""
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least 1")
    return value


def seconds(text: str) -> float:
    """A finite number of at least 0."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (value >= 0 and math.isfinite(value)):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds, 0 or more")
    return value
