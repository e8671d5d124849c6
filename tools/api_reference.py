"""The API reference from the docstrings: `python tools/api_reference.py` writes build/api/stream_sfm.html.

Public names are imported on first use, and pdoc documents those that are imported; therefore all are used first. A
warning, such as that of a name that does not resolve, is an error.
"""

import argparse
import contextlib
import inspect
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, get_origin, get_type_hints
from unittest import mock

import msgspec
import pdoc

import stream_sfm


def write_reference(folder: Path) -> Path:
    """Write the reference of all public names into `folder`; the page to open."""
    for name in stream_sfm.__all__:
        getattr(stream_sfm, name)
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    # away from the checkout, whose folder stream_sfm could be meant as well as the installed package
    with warnings.catch_warnings(), contextlib.chdir(folder), settings_in_words():
        warnings.simplefilter("error")
        pdoc.render.configure(
            docformat="markdown", show_source=False, footer_text=f"stream_sfm {stream_sfm.__version__}"
        )
        pdoc.pdoc("stream_sfm", r"!stream_sfm\.", output_directory=folder)
    return folder / "stream_sfm.html"


@contextlib.contextmanager
def settings_in_words() -> Iterator[None]:
    """Have pdoc write the type of a setting, and its meaning and bounds as its description."""
    plain, documented = inspect.formatannotation, pdoc.doc.Class._var_docstrings.func

    def formatted(annotation: Any, *more: Any, **named: Any) -> str:
        is_setting = get_origin(annotation) is Annotated
        return plain(annotation.__origin__ if is_setting else annotation, *more, **named)

    def described(of: pdoc.doc.Class) -> dict[str, str]:
        if not issubclass(of.obj, msgspec.Struct):
            return documented(of)
        hints = get_type_hints(of.obj, include_extras=True).items()
        metas = {name: hint.__metadata__[0] for name, hint in hints if get_origin(hint) is Annotated}
        return {name: in_words(meta) for name, meta in metas.items() if isinstance(meta, msgspec.Meta)}

    with (
        mock.patch("inspect.formatannotation", formatted),
        mock.patch("pdoc.doc.formatannotation", formatted),
        mock.patch.object(pdoc.doc.Class, "_var_docstrings", property(described)),
    ):
        yield


def in_words(meta: msgspec.Meta) -> str:
    """The description of a setting, with its bounds."""
    bounds = "" if meta.ge is None else f" ({meta.ge:g} to {meta.le:g})"
    return f"{meta.description}{bounds}"


def main() -> None:
    """Write the reference and print where it is."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("build/api"), help="folder (default build/api)")
    print(write_reference(parser.parse_args().out))


if __name__ == "__main__":
    main()
