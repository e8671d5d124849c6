"""The templates, style sheets and scripts of the pages."""

from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup


def template(name: str) -> Template:
    """A template of this folder; inserted text is escaped, and an unknown name in the template is an error."""
    environment = Environment(
        loader=PackageLoader("stream_sfm.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


def inline(name: str) -> Markup:
    """The text of a style sheet or script of this folder, to be inserted unescaped."""
    return Markup(files(__package__).joinpath(name).read_text(encoding="utf-8"))
