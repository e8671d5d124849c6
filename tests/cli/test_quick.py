"""Plain command lines are parsed without Cyclopts, as Cyclopts parses them."""

import inspect
from typing import Any

import pytest

from stream_sfm.cli.app import build_app
from stream_sfm.cli.quick import _names, _slots, call_of
from stream_sfm.cli.tables import COMMANDS, Family, Options, command

QUICK = ("replay", "live", "view", "inspect", "surface", "recover", "simulate", "config")
# A word for each kind of value; options with converters of their own need one that they take.
WORDS = {int: "7", float: "2.5", str: "a=b", list[str]: "c.d=e"}
SPECIAL = {
    "size": "640x480",
    "rate": "12.5",
    "exposure": "3",
    "ground-truth-std": "0.001,0.0005",
    "ignore-ground-truth": "0:15,20:30",
    "experiment": "rates",
    "method": "ekf",
    "world": "gravity",
}


def parsed_by_both(words: list[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The arguments of the function that a command line calls, `Options` as dicts."""

    def plain(function: Any, args: Any, named: Any) -> dict[str, Any]:
        bound = inspect.signature(function).bind(*args, **named)
        bound.apply_defaults()
        values = bound.arguments.items()
        return {name: of_options(v) if isinstance(v, Options) else v for name, v in values}

    def of_options(of: Options) -> dict[str, Any]:
        return {name: getattr(of, name) for kind in type(of).__mro__ for name in vars(kind).get("__annotations__", ())}

    quick: Any = call_of(words)
    assert quick is not None, words
    _, bound, _ = build_app().parse_args(words)
    return plain(quick.func, quick.args, quick.keywords), plain(quick.func, bound.args, bound.kwargs)


def lines(name: str) -> list[list[str]]:
    """Every argument of a command alone, twice and with `=`, and all together."""
    arguments = inspect.signature(command(name)).parameters.values()
    in_place, rest, all_of_them = [], [], []
    for slot in (slot for argument in arguments for slot in _slots(argument)):
        long, *_ = names = list(_names(slot))
        word = SPECIAL.get(long[2:]) or WORDS.get(slot.kind, "")
        if slot.argument.kind is inspect.Parameter.POSITIONAL_ONLY:
            in_place.append(word)
        elif slot.kind is bool:
            rest += [[each] for each in names]
            all_of_them += names
        elif "consume_multiple" not in slot.meaning:
            rest += [[long, word], [f"{long}={word}"], [long, word, long, word]]
            all_of_them += [long, word]
    wanted = ["--out", "o.ply"] if name == "surface" else []
    return [[name, *in_place, *each, *wanted] for each in [[], *rest, all_of_them]]


@pytest.mark.parametrize("name", QUICK)
def test_every_option_of_a_command_is_parsed_as_cyclopts_parses_it(name: str) -> None:
    for words in lines(name):
        quick, full = parsed_by_both(words)
        assert quick == full, words


@pytest.mark.parametrize("name", sorted(set(COMMANDS) - set(QUICK)))
def test_families_and_commands_of_any_number_of_words_are_left_to_cyclopts(name: str) -> None:
    found = command(name)
    kinds = [] if isinstance(found, Family) else [p.kind for p in inspect.signature(found).parameters.values()]
    assert not kinds or inspect.Parameter.VAR_POSITIONAL in kinds
    assert call_of([name, "a"]) is None


@pytest.mark.parametrize(
    "line",
    [
        "",
        "fly",
        "replay",
        "replay --help",
        "replay a b",
        "replay a --nothing",
        "replay a --strict=true",
        "replay a -qv",
        "replay a --start -1",
        "replay a --left",
        "replay a --out=",
        "replay a --max-frames 0",
        "replay a --max-frames 1_0",
        "replay a --max-frames 1e2",
        "replay a --method magic",
        "replay a --mask l.png r.png",
        "replay a --calibration x --calibration y --calibration z",
        "replay -- a",
    ],
)
def test_what_is_not_plain_is_left_to_cyclopts(line: str) -> None:
    assert call_of(line.split()) is None
