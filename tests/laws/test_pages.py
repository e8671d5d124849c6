"""The pages fit the code: links and names exist, cited equations exist, walks are short, and tools find everything."""

import ast
import re
from itertools import pairwise, product
from pathlib import Path

import pytest

from stream_sfm import pipeline
from stream_sfm.config import Config, read_config, setting_names
from stream_sfm.logs.recording.images import RAW_ENCODINGS
from stream_sfm.logs.sources.image_header import COMPRESSED_FORMATS
from tests.helpers.places import ROOT
from tests.laws.test_imports import LEVEL
from tools.ablation import RULES
from tools.bench_jobs import stages

PAGES = sorted(p for folder in ("", "docs", "examples", "logs", "tests", "tools") for p in (ROOT / folder).glob("*.md"))
CODE = sorted(path for kind in ("py", "cpp", "hpp") for path in (ROOT / "stream_sfm").rglob(f"*.{kind}"))
MATHEMATICS = (ROOT / "docs/mathematics.md").read_text(encoding="utf-8")
NUMBERED = re.compile(r"^    .*\((\d+)\)$", re.MULTILINE)  # an equation stands alone, its number at the end
STEP = re.compile(r"^\| \d+ \| `([\w/.]+)` \| `([\w.]+)` \|", re.MULTILINE)
WALKS = (ROOT / "docs/walks.md").read_text(encoding="utf-8")
STEPS = STEP.findall(WALKS)
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


def test_settings_that_the_pages_name_exist():
    """Of the sections that few runs change."""
    text = "\n".join(path.read_text(encoding="utf-8") for path in PAGES)
    named = set(re.findall(r"`((?:rules\.\w+|robust)\.\w+)`", text))
    assert named and named <= set(setting_names())


def functions(file: Path) -> set[str]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    names = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            names |= {f"{node.name}.{part.name}" for part in node.body if isinstance(part, ast.FunctionDef)}
    return names


def test_both_walks_are_read():
    # two walks of some fourteen steps
    assert [file for file, _ in STEPS].count("run/loop.py") == 2 and len(STEPS) > 25


@pytest.mark.parametrize("file,name", sorted(set(STEPS)))
def test_every_step_exists(file, name):
    assert name in functions(ROOT / "stream_sfm" / file), f"docs/walks.md leads to {name} in {file}"


@pytest.mark.parametrize("walk,files,climbs", [("replay", 15, 4), ("compare", 17, 5)])
def test_a_walk_is_short_and_goes_down(walk, files, climbs):
    """A climb leads into a room of a higher layer: a call back, or a value returned to a file named before."""
    part = next(part for part in WALKS.split("\n## ") if part.splitlines()[0].endswith(f"`{walk}`"))
    steps = [file for file, _ in STEP.findall(part)]
    levels = [LEVEL[file.split("/")[0].removesuffix(".py")] for file in steps]
    assert len(set(steps)) <= files and sum(a < b for a, b in pairwise(levels)) <= climbs


def source(file: str, name: str) -> str:
    text = (ROOT / "stream_sfm" / file).read_text(encoding="utf-8")
    return next(
        ast.get_source_segment(text, node) or ""
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef) and node.name == name
    )


@pytest.mark.parametrize(
    "column,file,step,parts",
    [
        (1, "frontend/front_end.py", "step", {"follow": "frontend/tracker.py", "_go_on": "", "_observed": ""}),
        (2, "estimators/window/cross_frame.py", "_advance", {"_initial_motion": "", "_report": ""}),
    ],
)
def test_the_verbs_of_both_steps_are_called_in_the_order_of_their_page(column, file, step, parts):
    """The page is the docstring of `pipeline/`; `parts` are functions whose verbs it names."""
    calls = source(file, step)
    for part, where in parts.items():
        calls = calls.replace(f"{part}(", source(where or file, part) + "(", 1)
    rows = re.findall(r"^    (\w.{32})(.{29})(.*)$", pipeline.__doc__ or "", re.MULTILINE)[1:]
    verbs = [name for row in rows for name in re.findall(r"^[\w., ]+", row[column]) for name in name.split(", ")]
    assert len(verbs) > 12
    at = 0
    for verb in (verb.strip() for verb in verbs):
        assert f"{verb}(" in calls[at:], f"{verb} is not called where the page says so"
        at = calls.index(f"{verb}(", at)


def test_the_benchmark_times_functions_that_exist() -> None:
    for stage, functions in stages().items():
        assert all(callable(getattr(owner, name, None)) for owner, name in functions), stage


def test_the_ablation_switches_rules_by_settings_and_the_page_has_them() -> None:
    page = (ROOT / "docs/rules.md").read_text(encoding="utf-8")
    for rule, overrides in RULES.items():
        assert read_config(None, overrides) != Config(), rule
        assert f"| {rule} |" in page, f"docs/rules.md does not have the rule {rule!r}"


def test_the_log_profile_lists_every_encoding():
    """The one list is that of `recording/images.py`; families are written with braces."""
    page = (ROOT / "docs/log-profile.md").read_text(encoding="utf-8")
    line = next(line for line in page.splitlines() if line.startswith("**Images.** Raw:"))
    told = set()
    for name in re.findall(r"`([^`]+)`", line):
        options = [
            re.findall(r"[^,{}]+", part) if "{" in part else [part] for part in re.split(r"(\{[^}]*\})", name) if part
        ]
        told |= {"".join(parts).lower() for parts in product(*options)}
    assert set(RAW_ENCODINGS) | set(COMPRESSED_FORMATS) <= told
