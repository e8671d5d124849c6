"""Completes commands, options, methods and settings in the shell, by argcomplete.

A user activates it with `eval "$(register-python-argcomplete stream-sfm)"` in bash or zsh; the shell then runs the
program with variables in its environment that ask for the words instead of a run.
"""

import argparse
import os
from collections.abc import Iterator
from typing import Any

from .parser import Parser


def complete(parser: Parser) -> None:
    """Answer the shell and exit, if it asks; return at once otherwise."""
    if "_ARGCOMPLETE" not in os.environ:
        return
    import argcomplete

    for action in _actions(parser):
        if action.dest == "set":
            action.completer = _settings  # type: ignore[attr-defined]  # where argcomplete looks for it
    argcomplete.autocomplete(parser, always_complete_options="long")


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """All arguments of a parser and of its commands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions(command)


def _settings(**_: Any) -> list[str]:
    """The beginning of every `--set`: the name of a setting and the sign of equality."""
    import msgspec

    from ..config import Config

    return [f"{name}=" for name in _names(msgspec.to_builtins(Config()))]


def _names(section: dict[str, Any]) -> Iterator[str]:
    for key, value in section.items():
        if isinstance(value, dict):
            yield from (f"{key}.{name}" for name in _names(value))
        else:
            yield key
