"""The package: one version everywhere, types shipped, and messages in which only the command line names its options."""

import ast
import re
import tomllib
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import pytest

import stream_sfm
from tests.helpers.places import ROOT

PACKAGE = Path(stream_sfm.__file__).parent
RUN_OTHER_PROGRAMS = ("batch/job.py", "viewer/recording.py")  # ours, and Rerun


@pytest.mark.parametrize(
    ("page", "pattern"), [("CHANGELOG.md", r"^## (\S+)"), ("CITATION.cff", r"^version: (\S+)$")]
)
def test_the_version_is_the_same_everywhere(page, pattern):
    found = re.search(pattern, (ROOT / page).read_text(encoding="utf-8"), re.MULTILINE)
    assert found and found[1] == stream_sfm.__version__ == version("stream-sfm")


def test_the_container_is_built_of_files_that_are_there():
    """Docker is not at hand: what it is given, and what the build needs, agree."""
    given = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    kept = {name.removeprefix("!") for name in given if name.startswith("!")}
    assert all((ROOT / name).exists() for name in kept)
    content = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    project, build = content["project"], content["build-system"]
    assert {project["readme"], *project["license-files"], *build["backend-path"], "stream_sfm"} <= kept
    image = re.search(r"python:3\.(\d+)", (ROOT / "Dockerfile").read_text(encoding="utf-8"))
    versions = re.findall(r"Python :: 3\.(\d+)", " ".join(project["classifiers"]))
    assert image and image[1] in versions and project["requires-python"] == f">=3.{versions[0]}"


def test_types_are_shipped():
    assert (PACKAGE / "py.typed").exists()


def messages(path: Path) -> Iterator[str]:
    """Literal texts of a file, but for its docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    documentation = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documentation:
            yield node.value


def test_no_message_of_the_library_names_an_option():
    """It states facts and remedies in words."""
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE).as_posix()
        if not name.startswith("cli/") and name not in RUN_OTHER_PROGRAMS:
            for text in messages(path):
                assert not re.search(r"(^|[ (`])--[a-z]|stream-sfm [a-z]", text), f"{name}: {text}"
