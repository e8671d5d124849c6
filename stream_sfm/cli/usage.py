"""Usage errors, and hints to the options and commands that help."""

from collections.abc import Iterable, Sequence
from typing import get_args

from cyclopts import (
    App,
    CoercionError,
    CycloptsError,
    MissingArgumentError,
    UnknownCommandError,
    UnknownOptionError,
    UnusedCliTokensError,
    ValidationError,
)

from ..errors import StreamSfmError
from ..wording import did_you_mean, unknown_name

_PAIR = "--calibration"  # takes the files of left and right one after the other, too
_OF_CALIBRATIONS = (".yaml", ".yml", ".json", ".xml", ".toml", ".txt", ".npz")

# By the names that errors use (`StreamSfmError.hint`): arguments of the library's functions as options, functions as
# commands.
OPTIONS = {
    "calibration": "--calibration FILE",
    "left": "--left TOPIC",
    "right": "--right TOPIC",
    "overwrite": "--force",
    "ground_truth": "--ground-truth FILE",
    "ground_truth_frame": "--ground-truth-frame FRAME",
    "mono": "--mono",
    "rate_hz": "--rate HZ",
    "rrd": "--rrd FILE",
    "size": "--size W×H",
}
COMMANDS = {
    "replay_batch": "`stream-sfm batch DIR` replays all of a folder",
    "config_to_toml": "`stream-sfm config --expert` prints every setting",
    "import_images": "`stream-sfm import --help` lists what can be imported",
    "inspect": "`stream-sfm inspect LOG` checks the calibration against the images",
}


def rewritten(words: Sequence[str]) -> list[str]:
    """The words of a command line as they are parsed: --calibration is repeated where two files follow it."""
    words = list(words)
    if words[:2] == ["import", "images"] and (out := next((w for w in words if w.endswith(".mcap")), None)):
        words.remove(out)  # which --left or --right before it would take as one more image
        words.insert(2, out)
    found: list[str] = []
    for at, word in enumerate(words):
        after_one = at >= 2 and words[at - 2] == _PAIR and not word.startswith("-")
        if after_one and all(name.lower().endswith(_OF_CALIBRATIONS) for name in words[at - 1 : at + 1]):
            found.append(_PAIR)
        found.append(word)
    return found


def usage_error(app: App, words: Sequence[str], error: CycloptsError) -> tuple[str, str]:
    """What is wrong with a command line, and where to read on."""
    chain, _, _ = app.parse_commands(list(words))
    return _wrong(error), f"hint: `{' '.join(['stream-sfm', *chain])} --help` lists all arguments"


def _wrong(error: CycloptsError) -> str:
    if isinstance(error, UnknownOptionError):
        name = (error.token.keyword or error.token.value).partition("=")[0]
        if name == "-":
            return "standard input is not read: give a file"
        return f"unknown option {name!r}{did_you_mean(name, _long(error.argument_collection))}"
    if isinstance(error, UnknownCommandError):
        name = (error.unused_tokens or [""])[0]
        commands = [known for known in error.app or () if not known.startswith("-")]
        return unknown_name("command", name, commands)
    if isinstance(error, UnusedCliTokensError):
        return f"unknown argument {(error.unused_tokens or [''])[0]!r}"
    name = "" if error.argument is None else error.argument.name
    if isinstance(error, MissingArgumentError):
        given = error.keyword or (error.argument is not None and error.argument.tokens)
        return f"{name}: a value is missing" if given else f"{name} is missing"
    if isinstance(error, ValidationError):
        return f"{name}: {error.exception_message}"
    if isinstance(error, CoercionError):
        value = error.token.value if error.token else ""
        if error.msg is not None:
            return f"{name}: {error.msg}"
        if choices := get_args(error.target_type):
            return unknown_name(name.lstrip("-").replace("-", " ").lower(), value, choices)
        return f"{name}: {value!r} is not {_KINDS.get(error.target_type or str, 'valid')}"
    return str(error).splitlines()[-1]


_KINDS: dict[type, str] = {int: "a whole number", float: "a number", bool: "true or false"}


def _long(arguments: Iterable[object]) -> list[str]:
    return [name for argument in arguments for name in getattr(argument, "names", ()) if name.startswith("--")]


def option_names(app: App, words: Sequence[str]) -> list[str]:
    """The long names of all options of the command that was given."""
    _, apps, _ = app.parse_commands(list(words))
    return _long(apps[-1].assemble_argument_collection())


def hint(error: StreamSfmError, words: Sequence[str], known: Sequence[str]) -> str:
    """One line that says which `known` options, or which other commands, help; empty where none does."""
    options = [OPTIONS[name] for name in error.hint if name in OPTIONS and OPTIONS[name].split()[0] in known]
    if words[0] == "import":
        options = [option.replace("TOPIC", "FILES") for option in options]
    parts = [f"use {' '.join(options)}"] if options else []
    parts += [COMMANDS[name] for name in error.hint if name in COMMANDS and name != words[0]]
    return f"hint: {'; '.join(parts)}" if parts else ""
