"""`stream-sfm config`: the settings as commented TOML."""

import argparse
from typing import Any

from ..errors import ExitCode
from . import arguments


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "config",
        help="print all settings with their defaults as commented TOML",
        description="Print all settings as commented TOML: the defaults, or what --config and --set make of them.",
    )
    arguments.add_configuration(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the configuration."""
    from ..config import config_to_toml, read_config

    print(config_to_toml(read_config(args.config, args.set)), end="")
    return ExitCode.DONE
