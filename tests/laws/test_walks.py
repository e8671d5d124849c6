"""docs/walks.md leads along functions that exist, and they are short; the tools time and replace what exists."""

import ast
import re
from itertools import pairwise
from pathlib import Path
from unittest.mock import patch

import pytest

import stream_sfm
from tests.helpers.places import ROOT
from tests.laws.test_imports import LEVEL
from tools.ablation import RULES
from tools.bench_jobs import stages

PACKAGE = Path(stream_sfm.__file__).parent
STEP = re.compile(r"^\| \d+ \| `([\w/.]+)` \| `([\w.]+)` \|", re.MULTILINE)
PAGE = (ROOT / "docs/walks.md").read_text(encoding="utf-8")
STEPS = STEP.findall(PAGE)


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
    assert name in functions(PACKAGE / file), f"docs/walks.md leads to {name} in {file}"


@pytest.mark.parametrize("walk,files,climbs", [("replay", 15, 4), ("compare", 17, 5)])
def test_a_walk_is_short_and_goes_down(walk, files, climbs):
    """A climb leads into a room of a higher layer: a call back, or a value returned to a file named before."""
    part = next(part for part in PAGE.split("\n## ") if part.splitlines()[0].endswith(f"`{walk}`"))
    steps = [file for file, _ in STEP.findall(part)]
    levels = [LEVEL[file.split("/")[0].removesuffix(".py")] for file in steps]
    assert len(set(steps)) <= files and sum(a < b for a, b in pairwise(levels)) <= climbs


def test_the_benchmark_times_functions_that_exist() -> None:
    for stage, functions in stages().items():
        assert all(callable(getattr(owner, name, None)) for owner, name in functions), stage


def test_the_ablation_switches_rules_that_exist() -> None:
    page = (ROOT / "docs/rules.md").read_text(encoding="utf-8")
    for rule, (name, instead) in RULES.items():
        with patch(f"stream_sfm.{name}", instead):  # raises where there is nothing of that name
            assert rule in page, f"docs/rules.md does not have the rule {rule!r}"
