"""The argument parser: argparse with errors in the words of this package, and with suggestions for misspelt names."""

import argparse
import sys
import textwrap
from collections.abc import Sequence
from typing import Any, NoReturn

from ..errors import ExitCode
from ..wording import did_you_mean, printable, unknown_name

_PAIR = "--calibration"  # takes the files of left and right one after the other, too
_OF_CALIBRATIONS = (".yaml", ".yml", ".json", ".xml", ".toml", ".txt")


def _repeated(arguments: Sequence[str]) -> list[str]:
    """The arguments, with the option repeated where two calibrations follow it: argparse would take the log as well."""
    found: list[str] = []
    for at, text in enumerate(arguments):
        after_one = at >= 2 and arguments[at - 2] == _PAIR and not text.startswith("-")
        if after_one and all(name.lower().endswith(_OF_CALIBRATIONS) for name in arguments[at - 1 : at + 1]):
            found.append(_PAIR)
        found.append(text)
    return found


class Formatter(argparse.HelpFormatter):
    """Help texts whose lines break between words only: not at a hyphen, where names and options would be cut."""

    def _format_action(self, action: argparse.Action) -> str:
        text = super()._format_action(action)
        is_list_of_commands = isinstance(action, argparse._SubParsersAction)
        return text.partition("\n")[2] if is_list_of_commands else text  # without the line that only says COMMAND

    def _split_lines(self, text: str, width: int) -> list[str]:
        return textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return "\n".join(indent + line for line in self._split_lines(text, width))


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are two lines: what is wrong, and where to read on."""

    def __init__(self, **options: Any) -> None:
        super().__init__(formatter_class=Formatter, add_help=False, **options)

    def error(self, message: str) -> NoReturn:
        """Print the error and exit as for every wrong use."""
        text = message.removeprefix("argument ")
        self.exit(
            ExitCode.USAGE, f"stream-sfm: {printable(text)}\nhint: `{self.prog} --help` lists all arguments\n"
        )

    def parse(self, arguments: Sequence[str] | None) -> argparse.Namespace:
        """Parse like `parse_args`; an unknown option is answered by the nearest one."""
        parsed, rest = self.parse_known_args(_repeated(sys.argv[1:] if arguments is None else arguments))
        if rest:
            parser = self.chosen(parsed)
            name = next((text for text in rest if text.startswith("-")), rest[0]).split("=")[0]
            kind = "option" if name.startswith("-") else "argument"
            parser.error(f"unknown {kind} {name!r}{did_you_mean(name, parser.option_names())}")
        return parsed

    def chosen(self, parsed: argparse.Namespace) -> "Parser":
        """The parser of the command that was given; this one if there was none."""
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                parser: Parser | None = action.choices.get(getattr(parsed, action.dest))
                return parser.chosen(parsed) if parser else self
        return self

    def option_names(self) -> list[str]:
        """The long names of all options."""
        return [name for action in self._actions for name in action.option_strings if name.startswith("--")]

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            raise argparse.ArgumentError(None, unknown_name(action.dest.replace("_", " "), value, action.choices))
