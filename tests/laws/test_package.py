"""The package as it is installed: one version everywhere, types shipped."""

import re
from importlib.metadata import version
from pathlib import Path

import pytest

import stream_sfm
from tests.helpers.places import ROOT


@pytest.mark.parametrize(
    ("page", "pattern"), [("CHANGELOG.md", r"^## (\S+)"), ("CITATION.cff", r"^version: (\S+)$")]
)
def test_the_version_is_the_same_everywhere(page: str, pattern: str) -> None:
    found = re.search(pattern, (ROOT / page).read_text(encoding="utf-8"), re.MULTILINE)
    assert found and found[1] == stream_sfm.__version__ == version("stream-sfm")


def test_types_are_shipped() -> None:
    assert (Path(stream_sfm.__file__).parent / "py.typed").exists()
