"""How errors are shown: one line with the facts, and one with the options and commands that help."""

import argparse
import sys

from ..errors import StreamSfmError
from ..wording import printable

# By the names that errors use (`StreamSfmError.hint`): arguments of the library's functions as options, functions as
# commands.
OPTIONS = {
    "calibration": "--calibration FILE",
    "left": "--left TOPIC",
    "right": "--right TOPIC",
    "overwrite": "--force",
    "ground_truth_frame": "--ground-truth-frame FRAME",
    "layout": "--layout LAYOUT",
    "mono": "--mono",
    "rate_hz": "--rate HZ",
    "rrd": "--rrd FILE",
    "size": "--size W×H",
}
COMMANDS = {
    "replay_batch": "`stream-sfm batch DIR` replays all of a folder",
    "config_to_toml": "`stream-sfm config` prints every setting",
    "import_images": "`stream-sfm import --help` lists what can be imported",
    "inspect": "`stream-sfm inspect LOG` checks the calibration against the images",
}


def print_error(message: str) -> None:
    """One line on standard error; `batch` finds the errors of a replay by this prefix."""
    print(f"stream-sfm: {printable(message)}", file=sys.stderr)


def hint(error: StreamSfmError, args: argparse.Namespace) -> str:
    """One line that says which options of this command, or which other commands, help; empty where none does."""
    options = [OPTIONS[name] for name in error.hint if name in OPTIONS and hasattr(args, name)]
    if args.command == "import":
        options = [option.replace("TOPIC", "FILES") for option in options]
    parts = [f"use {' '.join(options)}"] if options else []
    parts += [COMMANDS[name] for name in error.hint if name in COMMANDS and name != args.command]
    return f"hint: {'; '.join(parts)}" if parts else ""
