"""Without Rerun everything works except the viewer, which says how to install it before any work is done."""

import subprocess
import sys
from pathlib import Path

import pytest

import stream_sfm as sfm
from tests.helpers.places import ROOM

# What is None there cannot be imported: as if the package were not installed.
WITHOUT = (
    "import sys; sys.modules['rerun'] = None; from stream_sfm.cli.main import main; sys.exit(main(sys.argv[1:]))"
)


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", WITHOUT, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=1800)


def test_a_replay_needs_no_viewer(tmp_path: Path) -> None:
    done = run("replay", ROOM, "--max-frames", 4, "--out", tmp_path / "out", "-q")
    assert done.returncode == 0, done.stderr
    assert len(sfm.read_results(tmp_path / "out")) == 4


@pytest.mark.parametrize("option", ["--rrd={d}/a.rrd", "--view"])
def test_commands_that_need_it_say_how_to_install_it_and_do_nothing(option: str, tmp_path: Path) -> None:
    done = run("replay", ROOM, "--out", tmp_path / "out", option.format(d=tmp_path))
    assert done.returncode == 2
    assert "the Rerun viewer is not installed: pip install rerun-sdk" in done.stderr
    assert len(done.stderr.splitlines()) == 1 and list(tmp_path.iterdir()) == []
