"""What is done to the words of a command line before they are parsed, and hints to options and commands that help."""

from collections.abc import Sequence

from ..errors import StreamSfmError

_PAIR = "--calibration"  # takes the files of left and right one after the other, too
_OF_CALIBRATIONS = (".yaml", ".yml", ".json", ".xml", ".toml", ".txt", ".npz", ".conf")

# Errors hint at arguments of the library's functions (`StreamSfmError.hint`), most of which are options by that name,
# and at other functions, which are commands.
_OPTIONS = {"overwrite": "force", "rate_hz": "rate"}
COMMANDS = {
    "replay_batch": "`stream-sfm batch DIR` replays all of a folder",
    "config_to_toml": "`stream-sfm config --expert` prints every setting",
    "import_images": "any two sets of images: "
    "`stream-sfm import images --left DIR --right DIR --calibration FILE --rate HZ OUT.mcap`",
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


def usage_error(words: Sequence[str], error: BaseException) -> tuple[str, str] | None:
    """What is wrong with a command line, and where to read on; None for another error."""
    from cyclopts import Argument, CycloptsError, MissingArgumentError, UnusedCliTokensError

    from .app import build_app

    if not isinstance(error, CycloptsError):
        return None
    chain, _, _ = build_app(words).parse_commands(list(words))
    problem, command = str(error), " ".join(["stream-sfm", *chain])
    problem = problem[:1].lower() + problem[1:]
    match error:
        case UnusedCliTokensError(unused_tokens=[*tokens]):
            problem = f"unexpected argument: {' '.join(tokens)}"
        case MissingArgumentError(keyword=str(option)):
            problem = f"{option} needs a value"
        case MissingArgumentError(argument=Argument() as argument) if "Did you mean" not in problem:
            problem = f"{argument.name} is missing"
        case _:
            problem = problem.replace(". give ", ": give ")
    return problem, f"hint: `{command} --help` lists all arguments"


def hint(words: Sequence[str], error: StreamSfmError) -> str:
    """One line that says which options of the command, or which other commands, help; empty where none does."""
    from .app import build_app

    _, apps, _ = build_app(words).parse_commands(list(words))
    arguments = apps[-1].assemble_argument_collection()
    known = {name: argument.parameter.metavar for argument in arguments for name in argument.names}
    options = [f"--{_OPTIONS.get(name, name).replace('_', '-')}" for name in error.hint]
    options = [" ".join(filter(None, (option, known[option]))) for option in options if option in known]
    parts = [f"use {' '.join(options)}"] if options else []
    parts += [COMMANDS[name] for name in error.hint if name in COMMANDS and name != words[0]]
    return f"hint: {'; '.join(parts)}" if parts else ""
