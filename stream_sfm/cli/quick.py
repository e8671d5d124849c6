"""Parses plain command lines without Cyclopts, whose import and tables are a tenth of the start of a replay.

It reads the descriptions that Cyclopts reads (`tables.py`), and leaves to it all that is not plain: help, completion,
wrong words, and rare spellings such as `--strict=true` or `-qv`.
"""

import inspect
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Literal, NamedTuple, get_args, get_origin

from .tables import COMMANDS, Family, Parameter, command, is_options

# Numbers that are certainly meant as such; Cyclopts takes more.
_NUMBERS = {int: re.compile(r"\d{1,9}"), float: re.compile(r"\d{1,9}(\.\d{1,9})?")}


class _Slot(NamedTuple):
    """Where a value goes: an argument of the command, a field of it if that is `Options`; its type and description."""

    argument: inspect.Parameter
    field: str
    kind: Any
    meaning: dict[str, Any]


def call_of(words: Sequence[str]) -> Callable[[], int | None] | None:
    """Return what a plain command line calls; None where Cyclopts shall parse it."""
    if not words or words[0] not in COMMANDS or isinstance(function := command(words[0]), Family):
        return None
    try:
        return _call(function, words[1:])
    except (LookupError, StopIteration, ValueError):  # not plain, or wrong
        return None


def _call(function: Callable[..., int | None], words: Sequence[str]) -> Callable[[], int | None]:
    arguments = inspect.signature(function).parameters.values()
    slots = [slot for argument in arguments for slot in _slots(argument)]
    places = [slot for slot in slots if slot.argument.kind is inspect.Parameter.POSITIONAL_ONLY]
    options = {name: slot for slot in slots if slot not in places for name in _names(slot)}
    given: dict[str, dict[str, Any]] = {}
    todo = iter(words)
    for word in todo:
        name, has_value, text = word.partition("=") if word.startswith("-") else ("", "", word)
        slot = options[name] if name else places.pop(0)
        values = given.setdefault(slot.argument.name, {})
        if slot.kind is not bool:
            if name and not has_value and (text := next(todo)).startswith("-"):
                raise ValueError(text)  # an option without its value, or a negative number
            values[slot.field] = _value(slot, text, values.get(slot.field))
        elif has_value:
            raise ValueError(word)
        else:
            values[slot.field] = True
    in_place, named = [], {}
    for argument in arguments:
        if argument.name in given:
            values, kind = given[argument.name], _parts(argument.annotation)[0]
            value = kind(**values) if is_options(kind) else values[""]
        elif (value := argument.default) is inspect.Parameter.empty:
            raise ValueError(argument.name)
        if argument.kind is inspect.Parameter.POSITIONAL_ONLY:
            in_place.append(value)
        else:
            named[argument.name] = value
    return partial(function, *in_place, **named)


def _slots(argument: inspect.Parameter) -> Iterator[_Slot]:
    if argument.kind is inspect.Parameter.VAR_POSITIONAL:
        raise ValueError(argument.name)
    kind, meaning = _parts(argument.annotation)
    if is_options(kind):
        for field, annotation in kind.__annotations__.items():
            yield _Slot(argument, field, *_parts(annotation))
    else:
        yield _Slot(argument, "", kind, meaning)


def _parts(annotation: Any) -> tuple[Any, dict[str, Any]]:
    """Return the type of an annotation, without None, and its description: of several the last counts."""
    meaning: dict[str, Any] = {}
    for each in getattr(annotation, "__metadata__", ()):
        meaning |= each.meaning if isinstance(each, Parameter) else {}
    kind = getattr(annotation, "__origin__", annotation) if hasattr(annotation, "__metadata__") else annotation
    if type(None) in (kinds := get_args(kind)):
        (kind,) = (each for each in kinds if each is not type(None))
    return kind, meaning


def _names(slot: _Slot) -> Iterator[str]:
    yield "--" + (slot.field or slot.argument.name).replace("_", "-")
    if "alias" in slot.meaning:
        yield slot.meaning["alias"]


def _value(slot: _Slot, word: str, before: Any) -> Any:
    """Return the value that a word stands for, after `before` if the option has been given before."""
    kind, meaning = slot.kind, slot.meaning
    if not word or "consume_multiple" in meaning:
        raise ValueError(word)
    if "converter" in meaning:
        value = meaning["converter"](word)
    elif kind in _NUMBERS and _NUMBERS[kind].fullmatch(word):
        value = kind(word)
    elif kind is str or (get_origin(kind) is Literal and word in get_args(kind)):
        value = word
    elif kind == list[str]:
        value = [*(before or ()), word]
    else:
        raise ValueError(word)
    if "validator" in meaning:
        meaning["validator"](value)
    return value
