"""What commands and their options are described with: `quick.py` and `app.py` read the same descriptions."""

from collections.abc import Callable
from importlib import import_module
from typing import Any, ClassVar, NamedTuple, TypeVar

T = TypeVar("T")

# Where each command is; only the files of those that the command line names are imported.
COMMANDS = {
    "replay": "replay:replay",
    "live": "replay:live",
    "evaluate": "finished_runs:evaluate",
    "view": "finished_runs:view",
    "compare": "compare:compare",
    "batch": "batch:batch",
    "inspect": "inspect:inspect",
    "surface": "surface:surface",
    "import": "copies:import_",
    "refine": "calibrations:refine",
    "recover": "copies:recover",
    "convert-calibration": "calibrations:convert_calibration",
    "simulate": "simulate:simulate",
    "config": "config:config",
}


class Group(NamedTuple):
    """A heading of the help, in the order of the keys."""

    name: str
    sort_key: int


class Parameter:
    """The description of an argument, with the names of Cyclopts; as a decorator, that of all fields of `Options`.

    Only `converter` and `validator` are simpler: functions of the word, and of the value.
    """

    def __init__(self, name: str | None = None, **meaning: Any) -> None:
        self.meaning = meaning if name is None else {"name": name, **meaning}

    def __call__(self, options: type[T]) -> type[T]:
        """Describe options."""
        assert issubclass(options, Options)
        options.described = self
        return options


class Options:
    """Options that belong together: a field for each, with its default. A dataclass takes more than a millisecond."""

    described: ClassVar[Parameter]

    def __init__(self, **given: Any) -> None:
        vars(self).update(given)


def is_options(kind: Any) -> bool:
    """Whether a type of an argument is one of `Options`."""
    return isinstance(kind, type) and issubclass(kind, Options)


class Family(NamedTuple):
    """A command of several ones, such as `import`."""

    name: str
    help: str
    members: list[Callable[..., Any]]

    def command(self, function: T) -> T:
        """Add a member."""
        self.members.append(function)  # type: ignore[arg-type]
        return function


def command(name: str) -> Any:
    """Return the function or the family of a command."""
    file, _, inside = COMMANDS[name].partition(":")
    return getattr(import_module(f"{__package__}.{file}"), inside)
