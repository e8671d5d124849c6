"""The pages beside the code: links and names lead somewhere, equations that are cited exist."""

import re

import pytest

from tests.helpers.places import ROOT

PAGES = sorted(
    p for folder in ("", "docs", "examples", "logs", "tests", "tools") for p in (ROOT / folder).glob("*.md")
)
CODE = sorted(path for kind in ("py", "cpp", "hpp") for path in (ROOT / "stream_sfm").rglob(f"*.{kind}"))
MATHEMATICS = (ROOT / "docs/mathematics.md").read_text(encoding="utf-8")
NUMBERED = re.compile(
    r"^    .*\((\d+)\)$", re.MULTILINE
)  # an equation stands alone, its number at the end of the line
CITED = re.compile(r"\beqs?\. \((\d+)\)(?:(?:–| and |, )\((\d+)\))?")


def anchor(heading: str) -> str:
    """What GitHub makes of a heading."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if re.match(r"https?:", target):
            continue
        name, _, place = target.partition("#")
        there = (page.parent / name).resolve() if name else page
        assert there.exists(), f"{page.name} links to {target}"
        if place:
            headings = re.findall(r"^#+ (.*)$", there.read_text(encoding="utf-8"), re.MULTILINE)
            assert place in map(anchor, headings), f"{page.name} links to {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_files_that_are_named_exist(page):
    """Names with a folder and a suffix; from the page, the root or the package."""
    names = re.findall(
        r"`((?:[\w.]+/)+[\w.]+\.(?:py|cpp|hpp|md|toml|json|mcap|png))`", page.read_text(encoding="utf-8")
    )
    for name in names:
        if not name.startswith(("runs/", "results/", "DIR/")):
            bases = (page.parent, ROOT, ROOT / "stream_sfm")
            assert any((base / name).exists() for base in bases), f"{page.name} names {name}"


def test_equations_are_numbered_in_order_and_cited_ones_exist():
    numbers = [int(n) for n in NUMBERED.findall(MATHEMATICS)]
    assert numbers == list(range(1, len(numbers) + 1))
    cited = {}
    for path in CODE:
        for match in CITED.finditer(path.read_text(encoding="utf-8")):
            cited |= {int(n): path.name for n in match.groups() if n}
    assert cited, "no docstring cites an equation"
    assert set(cited) <= set(numbers), {n: where for n, where in cited.items() if n not in numbers}


def test_constants_that_the_mathematics_name_exist():
    """Names in capitals between backticks are assigned somewhere in the package."""
    code = "\n".join(path.read_text(encoding="utf-8") for path in CODE)
    names = set(re.findall(r"`(_?[A-Z][A-Z_]{2,})`", MATHEMATICS))
    assert names
    missing = {name for name in names if not re.search(rf"\b{name}\b.*=", code)}
    assert not missing
