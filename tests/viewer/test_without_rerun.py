"""Without Rerun everything works except the viewer, which says how to install it before any work is done."""

import sys
from pathlib import Path

import pytest

from tests.helpers.places import ROOM


@pytest.mark.parametrize("option", ["--rrd={d}/a.rrd", "--view"])
def test_commands_that_need_it_say_how_to_install_it_and_do_nothing(
    option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)  # as if the package were not installed
    said = cli("replay", ROOM, "--out", tmp_path / "out", option.format(d=tmp_path), code=2).err
    assert "the Rerun viewer is not installed: pip install rerun-sdk" in said
    assert len(said.splitlines()) == 1 and list(tmp_path.iterdir()) == []
