"""Arguments that several commands share, and their checks."""

import argparse
import math


def add_log(parser: argparse.ArgumentParser) -> None:
    """LOG and how its cameras are found."""
    parser.add_argument("log", metavar="LOG", help="a stereo log (MCAP)")
    parser.add_argument("--left", metavar="TOPIC", help="topic of the left images, if it is not found by itself")
    parser.add_argument("--right", metavar="TOPIC", help="topic of the right images")
    parser.add_argument("--calibration", metavar="FILE", help="calibration (TOML) instead of the log's own")


def add_selection(parser: argparse.ArgumentParser) -> None:
    """Which frames."""
    parser.add_argument("--start", type=seconds, metavar="S", help="seconds from the first frame")
    parser.add_argument("--end", type=seconds, metavar="S", help="seconds from the first frame")
    parser.add_argument("--max-frames", type=positive, metavar="N", help="at most so many frames")
    parser.add_argument("--stride", type=positive, default=1, metavar="N", help="every N-th frame")


def add_configuration(parser: argparse.ArgumentParser) -> None:
    """Settings."""
    parser.add_argument("--config", metavar="FILE", help="settings (TOML); `stream-sfm config` prints all")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="one setting, as in window.frames=12"
    )


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
