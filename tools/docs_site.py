"""The documentation as a searchable site: `python tools/docs_site.py` writes build/site.

Pages, pictures and the API reference lie in the site as they do in the repository, so that their links are the same in
both. A link to a page or a heading that is not there is an error; one to another file of the repository leads to the
repository, if its address is known (GITHUB_SERVER_URL, GITHUB_REPOSITORY), and to a copy of the file otherwise.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from api_reference import write_reference

ROOT = Path(__file__).resolve().parents[1]
PAGES, SITE = ROOT / "build/site-pages", ROOT / "build/site"
_LINK = re.compile(r"(?<=\]\()(?![a-z]+:|#)([^)\s#]+)")  # a relative one, without its heading


def pages() -> list[Path]:
    """Return the pages of the repository that the site shows, by their places in it."""
    listed = subprocess.run(["git", "ls-files", "*.md"], cwd=ROOT, check=True, capture_output=True, text=True)
    return [Path(name) for name in listed.stdout.split()]


def collect(folder: Path) -> None:
    """Copy the pages and what they link to into a folder; README.md becomes the first page."""
    shutil.rmtree(folder, ignore_errors=True)
    names = set(pages())
    for name in names:
        text = (ROOT / name).read_text(encoding="utf-8")
        linked = {Path(os.path.normpath(name.parent / link)) for link in _LINK.findall(text)} - names
        for file in linked:
            if (ROOT / file).is_file():
                _copy(file, folder)
        text = _LINK.sub(lambda link, here=name: _moved(link[1], here), text)
        target = folder / (Path("index.md") if name == Path("README.md") else name)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, encoding="utf-8")
    write_reference(folder / "api")


def _copy(name: Path, folder: Path) -> None:
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(ROOT / name, folder / name)


def _moved(link: str, here: Path) -> str:
    """Return a link of the page `here` with the place of its target in the site."""
    target = Path(os.path.normpath(here.parent / link))
    if target == Path("README.md"):
        return os.path.relpath("index.md", here.parent)
    server, repository = (os.environ.get(f"GITHUB_{name}") for name in ("SERVER_URL", "REPOSITORY"))
    if (ROOT / target).is_dir() and server and repository:
        return f"{server}/{repository}/tree/{os.environ.get('GITHUB_SHA', 'HEAD')}/{target}"
    return link


def main() -> None:
    """Collect the pages and build the site; a warning, such as a dead link, is an error."""
    collect(PAGES)
    subprocess.run([sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"], cwd=ROOT, check=True)
    print(SITE / "index.html")


if __name__ == "__main__":
    main()
