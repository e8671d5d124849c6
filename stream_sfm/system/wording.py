"""Sentences that several rooms share: unknown names with the nearest known one, and invalid values in plain words."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

LISTED = 20  # names in one sentence, notes of one reading: a hostile file could give one per record
_KINDS = {
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "str": "text",
    "object": "a section",
}
_BOUNDS = {">=": "of at least", "<=": "of at most", ">": "greater than", "<": "less than"}
_EXPECTED = re.compile(r"Expected `(\w+)`(?: (>=|<=|>|<) (\S+))?")
_UNKNOWN = re.compile(r"Object contains unknown field `(.*?)`")
_PATH = re.compile(r" - at `\$\.?(.*)`$")


def printable(text: str) -> str:
    """Return a text on one line in visible characters; others, such as terminal escapes, appear as their codes.

    Names of topics, encodings and files may hold anything, which a terminal or a parser of lines would take as a
    command.
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode() for c in text)


def described(value: object) -> str:
    """Describe an argument of the wrong kind in a few words."""
    if value is None:
        return "None"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    text = f" ({value!r})" if isinstance(value, str | int | float | Path) else ""
    return f"of type {type(value).__name__}{text}"


def unknown_name(kind: str, name: str, known: Iterable[str]) -> str:
    """Say that a name is not known, with the nearest known name, or else with all of them."""
    from difflib import get_close_matches  # takes a millisecond to import

    known = list(known)
    nearest = get_close_matches(name, known, n=1, cutoff=0.7)  # one letter wrong in four
    cure = f"did you mean {nearest[0]}?" if nearest else f"known are {', '.join(known)}"
    return f"unknown {kind} {name!r}; {cure}"


def some_of(names: Sequence[str], separator: str = ", ") -> str:
    """Return names for a sentence: all of them, or the first ones and how many more there are."""
    more = len(names) - LISTED
    return separator.join(names[:LISTED]) + (f"{separator}and {more} more" if more > 0 else "")


def in_a_row(names: Sequence[str]) -> str:
    """Return at least one name as a list within a sentence."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def counted(n: int, thing: str) -> str:
    """Return a number of things: 1 frame, 2 frames."""
    return f"{n} {thing}{'' if n == 1 else 's'}"


def invalid_setting(problem: str, data: Mapping[str, Any], known: Mapping[str, Any]) -> str:
    """Return what msgspec's `problem` with the content `data` of a file means, in plain words.

    `known` has the structure of valid content: sections are mappings, settings anything else.
    """
    at = _PATH.search(problem)
    path = at.group(1).split(".") if at and at.group(1) else []
    if found := _UNKNOWN.match(problem):
        for section in path:
            known = known[section]
        name = ".".join([*path, found.group(1)])
        kind = "section" if isinstance(_value(data, name.split(".")), Mapping) else "setting"
        return unknown_name(kind, name, [".".join([*path, key]) for key in known])
    return f"setting {'.'.join(path)} is {_value(data, path)!r}; it must be {expected(problem)}"


def expected(problem: str) -> str:
    """Return the kind and the bounds of a valid value, from msgspec's `problem` with a value."""
    found = _EXPECTED.match(problem)
    if found is None:
        return problem
    kind, relation, bound = found.groups()
    words = _KINDS.get(kind, kind)
    return f"{words} {_BOUNDS[relation]} {bound}" if relation else words


def _value(data: Mapping[str, Any], path: Iterable[str]) -> Any:
    value: Any = data
    for key in path:
        value = value[key]
    return value
