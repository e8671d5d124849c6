"""What a release shows and holds: the page of the index, the source archive, the notices, the workflow."""

import os
import re
import sys

import pytest
from packaging.requirements import Requirement

from tests.helpers.places import ROOT

sys.path.insert(0, str(ROOT / "tools/build"))
import index_page


def test_links_of_the_index_page_are_absolute_and_lead_to_files(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    given = {"SERVER_URL": "https://forge.example", "REPOSITORY": "who/what", "REF_NAME": "v1.0"}
    for name, value in given.items():
        monkeypatch.setenv(f"GITHUB_{name}", value)
    found = index_page.dynamic_metadata({}, {})
    home = "https://forge.example/who/what/"
    links = re.findall(r"\]\(([^)]+)\)", found["readme"]["text"])
    inside = [link.removeprefix(home) for link in links if link.startswith(home)]
    assert len(inside) > 20 and all(link.startswith(("https://", "#")) for link in links)
    for link in inside:
        kind, ref, name = link.split("#")[0].split("/", 2)
        assert ref == "v1.0" and (ROOT / name).is_file(), link
        assert (kind == "raw") == name.endswith(".png"), link
    assert found["urls"]["Homepage"] == home.rstrip("/") and len(found["urls"]) == 4


def test_without_a_repository_the_readme_is_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    for name in [name for name in os.environ if name.startswith("GITHUB_")]:
        monkeypatch.delenv(name)
    found = index_page.dynamic_metadata({}, {})
    assert found == {
        "readme": {"content-type": "text/markdown", "text": (ROOT / "README.md").read_text(encoding="utf-8")},
        "urls": {},
    }


def test_what_the_core_contains_of_others_is_acknowledged() -> None:
    notice = (ROOT / "NOTICE").read_text(encoding="utf-8")
    assert "Wenzel Jakob" in notice and "Tessil" in notice
    assert Requirement("nanobind>=3.0").name in (ROOT / "stream_sfm/core/CMakeLists.txt").read_text(encoding="utf-8")


def test_the_site_has_a_place_for_every_page() -> None:
    shown = set(re.findall(r": (\S+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE))
    folders = (ROOT, *(ROOT / name for name in ("docs", "examples", "examples/ros2", "tests", "tools")))
    pages = {path.relative_to(ROOT).as_posix() for folder in folders for path in folder.glob("*.md")}
    assert shown == pages - {"README.md"} | {"index.md"}
