"""The package as it is installed: one version everywhere, types shipped."""

import re
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest

import stream_sfm
from tests.helpers.places import ROOT


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
    assert (Path(stream_sfm.__file__).parent / "py.typed").exists()
