"""`stream-sfm config`: the settings as commented TOML."""

import argparse
from typing import Any

from ..errors import ExitCode
from . import arguments


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser = arguments.add_command(
        subparsers,
        "config",
        run,
        summary="print all settings as commented TOML",
        description="Print all settings as commented TOML: the defaults, changed by --config and --set.",
        usage="[options]",
    )
    arguments.add_settings(parser, method=False)
    arguments.add_general(parser)


def run(args: argparse.Namespace) -> int:
    """Print the configuration."""
    from ..config import config_to_toml

    print(config_to_toml(arguments.read_settings(args)), end="")
    return ExitCode.DONE
