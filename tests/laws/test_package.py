"""The package as it is installed: one version everywhere, types shipped."""

import re
from importlib.metadata import version
from pathlib import Path

import stream_sfm
from tests.helpers.places import ROOT


def test_the_newest_entry_of_the_changelog_is_the_version() -> None:
    headings = re.findall(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert headings[0] == stream_sfm.__version__ == version("stream-sfm")


def test_types_are_shipped() -> None:
    assert (Path(stream_sfm.__file__).parent / "py.typed").exists()
