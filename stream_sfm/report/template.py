"""The templates of the pages, and how they write numbers and names."""

import re
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from .. import __version__

_UNKNOWN = Markup('<span class="nil">–</span>')
_LARGE = 1000  # from here on all digits before the point are shown


def render(template: str, /, **values: Any) -> str:
    """Fill in a template of this folder; inserted text is escaped, and an unknown name in the template is an error."""
    return _environment().get_template(template).render(version=__version__, **values)


@cache
def _environment() -> Environment:
    """Templates are compiled once per process: that takes longer than to fill them in."""
    environment = Environment(
        loader=PackageLoader("stream_sfm.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"num": num, "sig": sig, "breakable": breakable, "times": times}
    return environment


def num(value: float | None, digits: int = 2) -> str:
    """A number with fixed digits after the point; a dash for None."""
    if value is None:
        return _UNKNOWN
    text = f"{value:.{digits}f}"
    return text.replace("-", "−" if float(text) else "")


def sig(value: float | None, factor: float = 1.0) -> str:
    """A number with three significant digits, or all before the point; a dash for None."""
    if value is None:
        return _UNKNOWN
    x = factor * value
    return (f"{x:.0f}" if _LARGE <= abs(x) < 1e6 else f"{x:#.3g}").rstrip(".").replace("-", "−")


def times(figure: dict[str, Any] | None) -> str:
    """A ratio with its interval, such as ×1.42 [1.1, 1.8]; a dash for None."""
    if figure is None:
        return _UNKNOWN
    ends = figure["ci95"]
    interval = "" if ends is None else Markup(" <small>[{:.2f}, {:.2f}]</small>").format(*ends)
    return Markup("×{:.2f}{}").format(figure["value"], interval)


def breakable(name: str) -> Markup:
    """A long name, which a browser may break after its separators."""
    return Markup(re.sub(r"([/._-]+)", r"\1<wbr>", str(escape(name))))
