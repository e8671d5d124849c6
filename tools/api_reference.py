"""The API reference from the docstrings: `python tools/api_reference.py` writes build/api/stream_sfm.html.

Public names are imported on first use, and pdoc documents those that are imported; therefore all are used first. A
warning, such as that of a name that does not resolve, is an error.
"""

import argparse
import contextlib
import warnings
from pathlib import Path

import pdoc

import stream_sfm


def write_reference(folder: Path) -> Path:
    """Write the reference of all public names into `folder`; the page to open."""
    for name in stream_sfm.__all__:
        getattr(stream_sfm, name)
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    # away from the checkout, whose folder stream_sfm could be meant as well as the installed package
    with warnings.catch_warnings(), contextlib.chdir(folder):
        warnings.simplefilter("error")
        pdoc.render.configure(
            docformat="markdown", show_source=False, footer_text=f"stream_sfm {stream_sfm.__version__}"
        )
        pdoc.pdoc("stream_sfm", r"!stream_sfm\.", output_directory=folder)
    return folder / "stream_sfm.html"


def main() -> None:
    """Write the reference and print where it is."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("build/api"), help="folder (default build/api)")
    print(write_reference(parser.parse_args().out))


if __name__ == "__main__":
    main()
