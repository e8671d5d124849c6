"""The argument parser: argparse with errors in the words of this package, and with suggestions for misspelt names."""

import argparse
import textwrap
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Any, NoReturn

from ..errors import ExitCode


class Formatter(argparse.HelpFormatter):
    """Help texts whose lines break between words only: not at a hyphen, where names and options would be cut."""

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
        self.exit(ExitCode.USAGE, f"{self.prog}: {message}\nhint: `{self.prog} --help` lists everything it takes\n")

    def parse_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:
        """As in argparse; an unknown option is answered by those that look like it."""
        parsed, unknown = self.parse_known_args(args, namespace)
        if unknown:
            parser = self.command_parser(getattr(parsed, "command", None))
            name = next((text for text in unknown if text.startswith("-")), unknown[0]).split("=")[0]
            kind = "option" if name.startswith("-") else "argument"
            parser.error(f"unknown {kind} {name}{did_you_mean(name, parser.option_names())}")
        return parsed

    def command_parser(self, command: str | None) -> "Parser":
        """The parser of a command, this one where there is none of that name."""
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction) and command in action.choices:
                found: Parser = action.choices[command]
                return found
        return self

    def option_names(self) -> list[str]:
        """The long names of all options."""
        return [name for action in self._actions for name in action.option_strings if name.startswith("--")]

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            raise argparse.ArgumentError(None, unknown(str(action.metavar or "value"), value, action.choices))


def unknown(kind: str, name: str, known: Iterable[str]) -> str:
    """A sentence that a name is not known, with the nearest ones, else with all."""
    nearest = did_you_mean(name, known)
    return f"unknown {kind.lower()} {name!r}{nearest or '; known are ' + ', '.join(known)}"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The end of a sentence that suggests the names nearest to `name`; empty where none is near."""
    nearest = get_close_matches(name, list(known), n=2, cutoff=0.6)
    return f"; did you mean {' or '.join(nearest)}?" if nearest else ""
