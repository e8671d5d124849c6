"""The application of Cyclopts: help, completion, and all command lines that `quick.py` does not take."""

import inspect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, wraps
from typing import Annotated, Any

import cyclopts

from .. import __version__
from . import tables

_EXIT_CODES = (
    "Exit codes: 0 success; 1 internal error (a defect of stream-sfm); 2 wrong usage or configuration; 3 input "
    "unreadable, unsuitable or only partly read; 130 interrupted, with all results so far written. "
    "With --debug, every command prints the traceback of an error as well."
)
_PREFIX = "command_"  # of the names of commands in this module


def build_app(words: Sequence[str] = ()) -> cyclopts.App:
    """The application with all commands, and with the one that installs completions where `words` may ask for it."""
    app = cyclopts.App(
        name="stream-sfm",
        help="Estimate camera motion and local 3-D structure, with covariances, from stereo recordings.",
        help_format="plaintext",
        help_epilogue=_EXIT_CODES,
        version=f"stream-sfm {__version__}",
        # the last of two equal options wins, so that scripts can append theirs
        default_parameter=cyclopts.Parameter(negative=(), show_default=False, allow_repeating=True),
        result_action="return_value",
        exit_on_error=False,
        print_error=False,
        suppress_keyboard_interrupt=False,
    )
    for key, name in enumerate(tables.COMMANDS):
        app.command(f"{__name__}:{_PREFIX}{name}", name=name, sort_key=key)
    if not words or words[0].startswith("-"):
        app.register_install_completion_command(help="Install completion for your shell.")
    _complete_help(app, words[:1] if words and words[0] in tables.COMMANDS else tables.COMMANDS)
    return app


def _complete_help(app: cyclopts.App, names: Iterable[str]) -> None:
    """Let the help of these commands be wrapped at the width of the terminal, not where the docstrings are."""
    for sub in (app[name] for name in names if not name.startswith("-")):
        sub.help_epilogue = ""  # not the exit codes again
        if doc := sub.default_command and inspect.getdoc(sub.default_command):
            paragraphs = doc.partition("\n\nArgs:")[0].split("\n\n")
            sub.help = "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)
        _complete_help(sub, sub)


def __getattr__(name: str) -> Any:
    """Return a command as Cyclopts takes it, which asks for it when it needs it."""
    if not name.startswith(_PREFIX):
        raise AttributeError(name)
    found = tables.command(name.removeprefix(_PREFIX))
    if not isinstance(found, tables.Family):
        return _described(found)
    family = cyclopts.App(name=found.name, help=found.help)
    for member in found.members:
        family.command(_described(member))
    return family


def _described(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return the function with its arguments described for Cyclopts."""

    @wraps(function)
    def called(*args: Any, **named: Any) -> Any:
        return function(*args, **named)

    called.__annotations__ = {name: _annotation(kind) for name, kind in function.__annotations__.items()}
    return called


def _annotation(kind: Any) -> Any:
    if hasattr(kind, "__metadata__"):
        meaning = (_parameter(x) if isinstance(x, tables.Parameter) else x for x in kind.__metadata__)
        return Annotated[(_annotation(kind.__origin__), *meaning)]
    return _options(kind) if tables.is_options(kind) else kind


@cache
def _options(kind: Any) -> Any:
    """Return a dataclass of the same fields, described for Cyclopts."""
    members = {name: _annotation(each) for name, each in kind.__annotations__.items()}
    names = {"__annotations__": members, "__module__": kind.__module__, "__doc__": kind.__doc__}
    return _parameter(kind.described)(dataclass(frozen=True)(type(kind.__name__, (kind,), names)))


@cache
def _parameter(of: tables.Parameter) -> cyclopts.Parameter:
    meaning = dict(of.meaning)
    if "group" in meaning:
        meaning["group"] = _group(meaning["group"])
    if "converter" in meaning:
        convert = meaning["converter"]
        meaning["converter"] = lambda _kind, tokens: convert(tokens[-1].value)
    if "validator" in meaning:
        check = meaning["validator"]
        meaning["validator"] = lambda _kind, value: None if value is None else check(value)
    return cyclopts.Parameter(**meaning)


@cache
def _group(of: tables.Group) -> cyclopts.Group:
    return cyclopts.Group(of.name, sort_key=of.sort_key)
