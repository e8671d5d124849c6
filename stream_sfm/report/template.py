"""The templates of the pages, and the filters by which they write numbers and names."""

import re
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from .. import __version__
from .tables import text_of


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
    environment.filters |= {"number": text_of, "breakable": breakable}
    return environment


def breakable(name: str) -> Markup:
    """A long name, which a browser may break after its separators."""
    return Markup(re.sub(r"([/._-]+)", r"\1<wbr>", str(escape(name))))
