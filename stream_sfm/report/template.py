"""The templates and the files that go into a page as they are."""

from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup


def template(name: str) -> Template:
    """A template of this room; what is put into it is escaped, and a name it does not know is an error."""
    environment = Environment(
        loader=PackageLoader("stream_sfm.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


def inline(name: str) -> Markup:
    """A style sheet or script of this room."""
    return Markup(files(__package__).joinpath(name).read_text(encoding="utf-8"))
