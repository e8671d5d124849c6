"""Names of methods and runs, numbers and marked values in the tables of pages, and the filling of templates."""

import re
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from .. import __version__
from ..evaluation.figures import Figure, LengthUnit, number_text
from ..methods import COMPARED, METHODS


class Name(NamedTuple):
    """The head of a row: its name, a note below it, the colour of its lines (a variable of page.css), and a link."""

    text: str
    note: str = ""
    colour: str = ""
    href: str = ""


class Table(NamedTuple):
    """Headings with units, and rows of cells: text and its class, "best", "bad", "wrap" or empty."""

    headings: list[tuple[str, str]]
    rows: list[tuple[Name, list[tuple[str, str]]]]


def table(
    figures: Sequence[Figure],
    names: Sequence[Name],
    runs: Sequence[dict[str, Any]],
    units: dict[str, LengthUnit],
    compared: bool = True,
) -> Table:
    """Return the figures of some runs, a row each, without figures that no run has.

    The best of several values is marked if the runs are `compared`; runs of different logs are not.
    """
    headings, columns = [], []
    for figure in figures:
        values = [run.get(figure.key) for run in runs]
        if all(value is None for value in values):
            continue
        unit = units.get(figure.unit, LengthUnit(figure.unit, 1.0))
        sizes = [abs(v) for v in values if v is not None] if figure.best and compared else []
        least = min(sizes) if len(sizes) > 1 else None
        headings.append((figure.name, unit.name))
        columns.append([(text_of(v, unit.per_m), _mark(figure, v, least)) for v in values])
    return Table(headings, [(name, [column[k] for column in columns]) for k, name in enumerate(names)])


def _mark(figure: Figure, value: Any, least: float | None) -> str:
    if isinstance(value, str):
        return "wrap"
    if value is not None and figure.expected is not None and value > figure.expected[1]:
        return "bad"
    return "best" if value is not None and least is not None and abs(value) == least else ""


def text_of(value: Any, factor: float = 1.0) -> str:
    """Return a number with three significant digits, or all digits before the point; integers and text unchanged.

    A ratio with its interval is written as ×1.42 [1.1, 1.8], and None as a dash.
    """
    if value is None:
        return Markup('<span class="nil">–</span>')
    if isinstance(value, dict):
        interval = Markup(" <small>[{:.2f}, {:.2f}]</small>").format(*value["ci95"]) if value["ci95"] else ""
        return Markup("×{:.2f}{}").format(value["value"], interval)
    if isinstance(value, str | int):
        return value if isinstance(value, str) else str(value)
    return number_text(value, factor).replace("-", "−")


def sigma_text(of: dict[str, Any]) -> str:
    """Return the factor by which σ of a method over a span would have to grow, and that of its own part."""
    factor, own = of.get("sigma_factor"), of.get("sigma_factor_own")
    if factor is None:
        return ""
    return f"σ × {factor:.2g}" if own is None or own == factor else f"σ × {factor:.2g}, own {own:.2g}"


class Look(NamedTuple):
    """The name of a line in a chart, and its colour, a variable of page.css."""

    name: str
    colour: str


Looks = Callable[[str], Look]
_COLOURS = 10  # c1 to c10 of page.css
_LOOKS = {name: Look(METHODS[name].label, f"c{k}") for k, name in enumerate(COMPARED, 1)}
_OF_VARIANTS = {
    "-loops": "with loops",
    "-added": "motions added",
    "-replayed": "as replayed",
}  # suffixes of name and label


def of_method(name: str) -> Look:
    """Return how a method is named and drawn."""
    name = name.replace("_", "-")
    for ending, words in _OF_VARIANTS.items():
        if name.endswith(ending):
            return Look(f"{of_method(name.removesuffix(ending)).name}, {words}", f"c{_COLOURS}")
    return _LOOKS.get(name) or Look(METHODS[name].label if name in METHODS else name, "other")


def of_runs(names: Sequence[str]) -> Looks:
    """Return how runs are drawn, by the names of their folders: with the colours of the methods in order."""
    last = [Path(name).name for name in names]
    shown = [name if last.count(name) == 1 else whole for name, whole in zip(last, names, strict=True)]
    return {name: Look(shown[k], f"c{k % _COLOURS + 1}") for k, name in enumerate(names)}.__getitem__


def render(template: str, /, **values: Any) -> str:
    """Fill in a template of this folder; inserted text is escaped, and an unknown name in the template is an error."""
    return _environment().get_template(template).render(version=__version__, **values)


@cache
def _environment() -> Environment:
    """Return the templates, compiled once per process, as that takes longer than filling them in."""
    environment = Environment(
        loader=PackageLoader("stream_sfm.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": text_of, "breakable": breakable}
    return environment


def breakable(name: str) -> Markup:
    """Return a long name that a browser may break after its separators."""
    return Markup(re.sub(r"([/._-]+)", r"\1<wbr>", str(escape(name))))
